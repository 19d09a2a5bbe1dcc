"""Installs radcam_depth_ros, with `pip install .` as well as with `colcon build`."""

from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

PACKAGE = "radcam_depth_ros"
VERSION = ElementTree.parse("package.xml").getroot().findtext("version")
WEIGHTS_OF_WHEEL = "baff.safetensors"
"""All others are in the wheel radcam-depth-weights (docs/release.md); a checkout and a colcon workspace have all."""


class BuildPackage(build_py):
    """Leaves the other weights out where a wheel is built."""

    def finalize_options(self) -> None:
        """Takes the patterns of files; `bdist_wheel` is the command of pip and of `python -m build`."""
        if "bdist_wheel" in self.distribution.commands:
            patterns = self.distribution.package_data[PACKAGE]
            patterns[patterns.index("weights/*.safetensors")] = f"weights/{WEIGHTS_OF_WHEEL}"
        super().finalize_options()


def share_files(folder: str, *patterns: str, to: str = "") -> tuple[str, list[str]]:
    """Copies of a folder's files under share/<package>/<folder>, or <to>, where ROS tools look for them."""
    files = sorted(str(path) for pattern in patterns for path in Path(folder).glob(pattern))
    return f"share/{PACKAGE}/{to or folder}", files


setup(
    name=PACKAGE,
    version=VERSION,
    description="Metric depth images from one camera and its radars, a ROS 2 node",
    long_description=Path("README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    license_files=["LICENSE", f"{PACKAGE}/weights/LICENSE"],
    keywords=["depth estimation", "radar", "camera", "sensor fusion", "ROS 2"],
    classifiers=[
        "Development Status :: 4 - Beta",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        *(f"Programming Language :: Python :: {version}" for version in ("3.11", "3.12", "3.13")),
        "Topic :: Scientific/Engineering :: Image Recognition",
    ],
    maintainer="radcam_depth_ros developers",
    maintainer_email="radcam-depth@example.org",
    python_requires=">=3.10",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={
        PACKAGE: ["py.typed", "recipes/*.yaml", "weights/*.safetensors", "weights/*.yaml", "weights/LICENSE"]
    },
    cmdclass={"build_py": BuildPackage},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        share_files("config", "*.yaml", "*.xml"),
        share_files("config/fleet", "*.yaml", "*.json", "*.sh"),
        share_files("config/nav2", "*.yaml"),
        share_files("config/sensors", "*.yaml"),
        share_files(f"{PACKAGE}/recipes", "*.yaml", to="config/train"),
        share_files("launch", "*.launch.py", "*.launch.xml"),
        share_files("rviz", "*.rviz"),
        share_files("foxglove", "*.json"),
    ],
    zip_safe=False,
    install_requires=[
        "apsw>=3.46",
        'backports.zstd>=1.0; python_version < "3.14"',
        "lz4>=4.0",
        "matplotlib>=3.6",
        "numpy>=1.26",
        "opencv-python-headless>=4.6",
        "pydantic>=2.5",
        "PyYAML>=6.0",
        "rich>=13",
        "rosbags>=0.11.9",
        "safetensors>=0.4",
        "torch>=2.4",
        "typer>=0.12",
    ],
    extras_require={
        "ros": ["ros-jazzy-rclpy[fastrtps]>=7.1", "ros-jazzy-common-interfaces>=5.3"],
        "sim": ["embreex>=4.4"],
        "train": ["embreex>=4.4", "kornia>=0.8", "tensorboard>=2.18"],
        "weights": [f"radcam-depth-weights=={VERSION}"],
        "fleet": ["fsspec>=2024.6", "ray[client]>=2.50", "s3fs>=2024.6"],
        "onnx": ["onnx>=1.17", "onnxruntime>=1.20", "onnxscript>=0.5"],
        "view": ["av>=14", "rerun-sdk>=0.26"],
        "docs": [
            "ipykernel>=6.29",
            "mkdocs-material>=9.5",
            "mkdocstrings[python]>=0.27",
            "nbclient>=0.10",
            "nbformat>=5.10",
            "playwright>=1.48",
        ],
        "dev": [
            "av>=14",
            "bandit>=1.8",
            "colcon-common-extensions>=0.3",
            "hypothesis>=6.100",
            "kornia>=0.8",
            "mypy>=1.10",
            "onnx>=1.17",
            "onnxruntime>=1.20",
            "onnxscript>=0.5",
            "pip-audit>=2.8",
            "pytest>=8.2",
            "pytest-timeout>=2.3",
            "pytest-xdist>=3.6",
            "ruff>=0.5",
            "types-PyYAML",
        ],
        "release": [
            "build>=1.2",
            "cyclonedx-bom>=7.0",
            "pre-commit>=4.0",
            "twine>=6.1",
            "zizmor>=1.5",
        ],
    },
    entry_points={
        "console_scripts": [
            "radcam_depth_node = radcam_depth_ros.node:main",
            "radcam-depth = radcam_depth_ros.cli:main",
        ]
    },
)
