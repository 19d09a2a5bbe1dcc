"""The launch files, read and run without `launch`."""

from __future__ import annotations

import ast
import runpy
import sys
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock, patch

from radcam_depth_ros.encoder import OUTPUTS
from radcam_depth_ros.frame_builder import FrameBuilderConfig

LAUNCH = Path(__file__).parents[1] / "launch"
OUTPUT_TOPICS = tuple(output.topic for output in OUTPUTS.values())
INPUTS = (FrameBuilderConfig().image, FrameBuilderConfig().calibration_topic, *FrameBuilderConfig().radars)


def launch_functions(name: str) -> dict[str, Any]:
    """What a Python launch file defines; what it takes from `launch` and `launch_ros` does nothing.

    Args:
        name: The file's name.
    """
    path = LAUNCH / name
    imports = [node for node in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(node, ast.ImportFrom)]
    modules = [str(node.module) for node in imports if str(node.module).startswith("launch")]
    with patch.dict(sys.modules, {module: MagicMock() for module in modules}):
        return runpy.run_path(str(path))


def launch_mappings(path: Path) -> dict[str, ast.Dict]:
    """What a launch file assigns to names at its top level, of that the mappings, as they are written."""
    found = {}
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.AnnAssign):
            target: ast.expr = node.target
        elif isinstance(node, ast.Assign):
            target = node.targets[0]
        else:
            continue
        if isinstance(node.value, ast.Dict):
            found[ast.unparse(target)] = node.value
    return found


def mapping_keys(mapping: ast.Dict) -> set[str]:
    """The keys that are written out."""
    return {ast.literal_eval(key) for key in mapping.keys if key is not None}
