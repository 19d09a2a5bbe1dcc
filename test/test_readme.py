"""What the README says, against what is there."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_parameters_are_those_of_the_node() -> None:
    render = runpy.run_path(str(ROOT / "scripts/parameter_table.py"))["render"]
    assert render(README) == README, "run scripts/parameter_table.py"


@pytest.mark.parametrize("target", sorted(set(re.findall(r"make (\w+)", README))))
def test_make_targets_exist(target: str) -> None:
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)


@pytest.mark.parametrize("verb", sorted(set(re.findall(r"radcam-depth ([a-z]+(?:-[a-z]+)*)", README))))
def test_verbs_exist(verb: str) -> None:
    assert (ROOT / "radcam_depth_ros/cli" / f"{verb.replace('-', '_')}.py").is_file()


@pytest.mark.parametrize("path", sorted(set(re.findall(r"\]\(([^)#:]+)\)", README))))
def test_links_lead_somewhere(path: str) -> None:
    assert (ROOT / path).exists()


@pytest.mark.parametrize("path", sorted(set(re.findall(r"\b(?:config|launch|rviz)/[\w./]*\w", README))))
def test_files_exist(path: str) -> None:
    assert (ROOT / path).exists()
