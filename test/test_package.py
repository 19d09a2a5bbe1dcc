"""What gets installed: metadata, files, dependencies."""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import setuptools
import yaml

import radcam_depth_ros

PACKAGE = "radcam_depth_ros"
ROOT = Path(__file__).parents[1]
SOURCE = ROOT / PACKAGE
DISTRIBUTIONS = {
    "backports": "backports.zstd",
    "cv2": "opencv-python-headless",
    "rerun": "rerun-sdk",
    "yaml": "PyYAML",
}  # where the imported name differs
EXTRAS = ("sim", "fleet", "view")
"""Extras of what the package imports."""
FROM_ROS = {  # by the extra `ros` or by apt
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "lifecycle_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rclpy",
    "sensor_msgs",
    "std_msgs",
    "tf2_msgs",
}


@pytest.fixture(scope="module")
def setup_arguments() -> dict[str, Any]:
    """What setup.py passes to setuptools."""
    captured: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        patch.setattr(setuptools, "setup", captured.update)
        exec(compile((ROOT / "setup.py").read_text(encoding="utf-8"), "setup.py", "exec"), {"__name__": "__main__"})
    return captured


@pytest.fixture(scope="module")
def manifest() -> ElementTree.Element:
    return ElementTree.parse(ROOT / "package.xml").getroot()


def requirement_name(requirement: str) -> str:
    return re.split(r"[\[<>=~! ]", requirement)[0].lower()


def imported_distributions() -> set[str]:
    names = set()
    for path in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(str(node.module).split(".")[0])
    later = {"compression"}  # of the standard library from Python 3.14
    return names - {PACKAGE, "__future__", *later, *sys.stdlib_module_names}


def test_one_version_everywhere(setup_arguments: dict[str, Any], manifest: ElementTree.Element) -> None:
    assert setup_arguments["version"] == radcam_depth_ros.__version__ == manifest.findtext("version")


def test_one_licence_everywhere(setup_arguments: dict[str, Any], manifest: ElementTree.Element) -> None:
    assert setup_arguments["license"] == manifest.findtext("license") == "Apache-2.0"
    assert "Apache License" in (ROOT / "LICENSE").read_text(encoding="utf-8")


def test_package_xml_is_valid_and_says_ament_python() -> None:
    catkin_package = pytest.importorskip("catkin_pkg.package")
    warnings: list[str] = []
    package = catkin_package.parse_package(str(ROOT / "package.xml"), warnings=warnings)
    package.validate(warnings=warnings)
    assert not warnings
    assert package.get_build_type() == "ament_python"


def test_every_import_is_declared(setup_arguments: dict[str, Any], manifest: ElementTree.Element) -> None:
    declared = {requirement_name(r) for r in setup_arguments["install_requires"]}
    declared |= {
        requirement_name(r)
        for name in ("sim", "train", "fleet", "onnx", "view")
        for r in setup_arguments["extras_require"][name]
    }
    imported = imported_distributions()
    others = {DISTRIBUTIONS.get(name, name).lower() for name in imported - FROM_ROS}
    assert others <= declared
    assert imported & FROM_ROS <= {str(element.text) for element in manifest.findall("depend")}


def test_nothing_is_declared_that_is_not_imported(setup_arguments: dict[str, Any]) -> None:
    declared = {requirement_name(r) for r in setup_arguments["install_requires"]}
    declared |= {
        requirement_name(r)
        for name in ("sim", "train", "fleet", "onnx", "view")
        for r in setup_arguments["extras_require"][name]
    }
    later = {"s3fs", "onnxscript", "tensorboard"}  # by fsspec, for s3://; by torch.onnx; by torch.utils.tensorboard
    assert declared - later <= {DISTRIBUTIONS.get(name, name).lower() for name in imported_distributions()}


def test_the_constraints_pin_all_requirements(setup_arguments: dict[str, Any]) -> None:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = {line.split("==")[0].lower() for line in lines if not line.startswith("#")}
    own = "weights"  # our other wheel, of this very version
    extras = [requirements for extra, requirements in setup_arguments["extras_require"].items() if extra != own]
    wanted = [setup_arguments["install_requires"], *extras]
    assert {requirement_name(requirement) for requirements in wanted for requirement in requirements} <= pinned


def test_all_packages_are_installed(setup_arguments: dict[str, Any]) -> None:
    folders = {path.parent for path in SOURCE.rglob("*.py")}
    assert {".".join(folder.relative_to(ROOT).parts) for folder in folders} == set(setup_arguments["packages"])


def test_the_executables_exist(setup_arguments: dict[str, Any]) -> None:
    for script in setup_arguments["entry_points"]["console_scripts"]:
        module, function = script.split(" = ")[1].split(":")
        path = ROOT.joinpath(*module.split("."))
        path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        body = ast.parse(path.read_text(encoding="utf-8")).body
        defined = {node.name for node in body if isinstance(node, ast.FunctionDef)}
        imported = {alias.name for node in body if isinstance(node, ast.ImportFrom) for alias in node.names}
        assert function in defined | imported


def test_what_ros_tools_look_for_is_shared(setup_arguments: dict[str, Any]) -> None:
    shared = dict(setup_arguments["data_files"])
    assert shared["share/ament_index/resource_index/packages"] == [f"resource/{PACKAGE}"]
    installed = {file for files in shared.values() for file in files}
    assert all((ROOT / file).is_file() for file in installed)
    for folder in ("config", "foxglove", "launch", "rviz"):
        wanted = {str(path.relative_to(ROOT)) for path in (ROOT / folder).rglob("*") if path.is_file()}
        assert {path for path in wanted if "__pycache__" not in path} <= installed


def test_weights_come_with_their_cards(setup_arguments: dict[str, Any]) -> None:
    weights = SOURCE / "weights"
    patterns = setup_arguments["package_data"][PACKAGE]
    installed = {path for pattern in patterns for path in SOURCE.glob(pattern)}
    assert {path for path in weights.rglob("*") if path.is_file()} <= installed
    assert len({path.stem for path in weights.glob("*.safetensors")}) >= 3
    for path in weights.glob("*.safetensors"):
        assert yaml.safe_load(path.with_suffix(".yaml").read_text(encoding="utf-8"))


def test_executables_go_where_ros_looks() -> None:
    assert f"install_scripts=$base/lib/{PACKAGE}" in (ROOT / "setup.cfg").read_text(encoding="utf-8")
