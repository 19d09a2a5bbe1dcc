"""The files that strangers and public services read: workflows, hooks, templates, model cards."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml

from radcam_depth_ros.networks import registry

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
WEIGHTS = sorted((ROOT / "radcam_depth_ros" / "weights").glob("*.safetensors"))
NUMBER = re.compile(r"(?<![\w.])\d+(?:,\d{3})*(?:\.\d+)?(?![\w.]*\w)")


def load(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_workflows_pin_actions_and_may_only_read(path: Path) -> None:
    workflow = load(path)
    assert workflow["permissions"] == {"contents": "read"}
    for job in workflow["jobs"].values():
        assert "permissions" not in job
        assert job["timeout-minutes"] <= 90
        assert "latest" not in job["runs-on"]
        for step in job["steps"]:
            if "uses" in step:
                assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}", step["uses"])
            if step.get("uses", "").startswith("actions/checkout@"):
                assert step["with"]["persist-credentials"] is False


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_what_workflows_run_exists(path: Path) -> None:
    for job in load(path)["jobs"].values():
        for step in job["steps"]:
            first, *words = shlex.split(step.get("run", "true"))
            if first == "make":
                assert all(re.search(rf"^{re.escape(word)}:", MAKEFILE, re.M) for word in words), words
            for name, value in step.get("env", {}).items():
                for script in re.findall(r"\.github/\S+\.sh", str(value)):
                    assert (ROOT / script).stat().st_mode & 0o111, name


def test_tests_run_with_each_python_that_make_takes() -> None:
    pythons = load(ROOT / ".github" / "workflows" / "ci.yml")["jobs"]["tests"]["strategy"]["matrix"]["python"]
    taken = re.findall(r"\((3), (\d+)\)", (ROOT / "scripts" / "make_venv").read_text(encoding="utf-8"))
    assert pythons == [".".join(version) for version in taken] == ["3.11", "3.12", "3.13"]


def test_hooks_are_the_commands_of_make_lint() -> None:
    (repo,) = load(ROOT / ".pre-commit-config.yaml")["repos"]
    lint = re.findall(r"^lint:.*\n((?:\t.*\n)+)", MAKEFILE, re.M)[0]
    assert repo["repo"] == "local"
    assert [hook["entry"] for hook in repo["hooks"]] == [line.strip("\t@") for line in lint.splitlines()]
    assert all(hook["language"] == "system" and hook["pass_filenames"] is False for hook in repo["hooks"])


def test_check_all_has_hooks_workflows_and_wheels() -> None:
    recipe = re.findall(r"^check-all:.*\n((?:\t.*\n)+)", MAKEFILE, re.M)[0]
    assert {"lint-files", "wheel"} <= set(recipe.split())


def test_the_development_container_makes_what_make_makes() -> None:
    container = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text(encoding="utf-8"))
    assert (ROOT / ".devcontainer" / container["build"]["dockerfile"]).is_file()
    first, *words = container["postCreateCommand"].split()
    assert first == "make"
    assert all(re.search(rf"^{re.escape(word)}:", MAKEFILE, re.M) for word in words)


@pytest.mark.parametrize("path", [path for path in FORMS if path.name != "config.yml"], ids=lambda path: path.name)
def test_forms_ask_for_what_inspect_prints(path: Path) -> None:
    form = load(path)
    assert {"name", "description", "body"} <= form.keys()
    fields = {field["id"]: field for field in form["body"] if field["type"] != "markdown"}
    assert "`radcam-depth inspect`" in fields["inspect"]["attributes"]["label"]
    assert all(field["attributes"]["label"] for field in fields.values())


@pytest.mark.parametrize("name", ["SECURITY.md", "CODE_OF_CONDUCT.md", ".github/pull_request_template.md"])
def test_pages_for_strangers_link_to_what_exists(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^):]+)\)", text):
        assert (ROOT / target).exists(), target


def test_each_weight_file_has_a_model_card() -> None:
    assert WEIGHTS
    cards = {path.stem for path in (ROOT / "docs" / "model_cards").glob("*.md")}
    assert cards == {path.stem for path in WEIGHTS}


@pytest.mark.parametrize("name", [path.stem for path in WEIGHTS])
def test_figures_of_model_cards_are_those_of_the_results(name: str) -> None:
    page = (ROOT / "docs" / "model_cards" / f"{name}.md").read_text(encoding="utf-8")
    assert {"## For what", "## Data", "## Figures", "## Where it fails", "## Licence"} <= set(page.splitlines())
    results = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    known = {*NUMBER.findall(results)}
    figures = {found for found in NUMBER.findall(page) if "." in found and found not in ("2.0",)}
    assert figures <= known, "figures of a model card come from docs/results.md"
    card = load(ROOT / "radcam_depth_ros" / "weights" / f"{name}.yaml")
    assert card["network"] == name in registry.names()
    assert f"{card['focal_length_px']:g} px" in page
    assert f"{card['min_depth_m']:g} to {card['max_depth_m']:g} m" in page
    frames, *seeds = re.findall(r"\d+ frames|(?<=seeds )\d+ to \d+", card["training_data"])[:2]
    assert frames in page
    assert all(seed in page for seed in seeds)
