"""The mappings of a Python launch file, read without `launch`."""

from __future__ import annotations

import ast
from pathlib import Path


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
