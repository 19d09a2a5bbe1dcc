"""Installs radcam_depth_ros, with `pip install .` as well as with `colcon build`."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "radcam_depth_ros"


def share_files(folder: str, *patterns: str, to: str = "") -> tuple[str, list[str]]:
    """Copies of a folder's files under share/<package>/<folder>, or <to>, where ROS tools look for them."""
    files = sorted(str(path) for pattern in patterns for path in Path(folder).glob(pattern))
    return f"share/{PACKAGE}/{to or folder}", files


setup(
    name=PACKAGE,
    version="0.1.0",
    description="Metric depth images from one camera and its radars, a ROS 2 node",
    long_description=Path("README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    maintainer="radcam_depth_ros developers",
    maintainer_email="radcam-depth@example.org",
    python_requires=">=3.10",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "recipes/*.yaml", "weights/*.safetensors", "weights/*.yaml"]},
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
        "fleet": ["fsspec>=2024.6", "ray[client]>=2.50", "s3fs>=2024.6"],
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
            "mypy>=1.10",
            "pip-audit>=2.8",
            "pytest>=8.2",
            "pytest-timeout>=2.3",
            "pytest-xdist>=3.6",
            "ruff>=0.5",
            "types-PyYAML",
        ],
    },
    entry_points={
        "console_scripts": [
            "radcam_depth_node = radcam_depth_ros.node:main",
            "radcam-depth = radcam_depth_ros.cli:main",
        ]
    },
)
