"""What `make release` writes, and when it refuses; `make wheel` builds and tries the wheels."""

from __future__ import annotations

import datetime
import re
import runpy
from pathlib import Path
from typing import Any

import pytest
import setuptools

import radcam_depth_ros
from radcam_depth_ros.networks.weights_io import archive

ROOT = Path(__file__).parents[1]
RELEASE: Any = runpy.run_path(str(ROOT / "scripts" / "release.py"))
HEAD = "^^^^\nName\n^^^^\n\n"
DAY = datetime.date(2031, 2, 3)


def test_the_unreleased_section_becomes_that_of_the_version() -> None:
    text = HEAD + "Forthcoming\n-----------\n* one\n* two\n\n0.9.0 (2030-01-01)\n------------------\n* before\n"
    assert RELEASE["released"](text, "1.0.0", DAY) == text.replace(
        "Forthcoming\n-----------", "1.0.0 (2031-02-03)\n------------------"
    )


@pytest.mark.parametrize(
    ("text", "version", "said"),
    [
        ("1.0.0 (2030-01-01)\n------------------\n* one\n", "1.1.0", "Forthcoming"),
        ("Forthcoming\n-----------\n\n1.0.0 (2030-01-01)\n------------------\n* one\n", "1.1.0", "write down"),
        ("Forthcoming\n-----------\n* two\n\n1.0.0 (2030-01-01)\n------------------\n* one\n", "1.0.0", "already"),
    ],
)
def test_a_changelog_without_news_is_refused(text: str, version: str, said: str) -> None:
    with pytest.raises(RELEASE["ReleaseError"], match=said):
        RELEASE["released"](HEAD + text, version, DAY)


@pytest.mark.parametrize(
    ("version", "changes", "tags", "said"),
    [
        ("1.2", "", "", "three numbers"),
        ("v1.2.3", "", "", "three numbers"),
        ("1.02.3", "", "", "three numbers"),
        ("1.2.3", "", "1.2.2\n1.2.3\n", "the tag 1.2.3 exists"),
        ("1.1.9", "", "", "from 1.2.0 on"),
        ("1.2.3", " M setup.py\n", "", "not committed"),
    ],
)
def test_a_version_that_cannot_be_is_refused(version: str, changes: str, tags: str, said: str) -> None:
    with pytest.raises(RELEASE["ReleaseError"], match=said):
        RELEASE["require_releasable"](version, "1.2.0", changes, tags)
    RELEASE["require_releasable"]("1.10.0", "1.2.0", "", "1.2.0\n")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # catkin_pkg's use of docutils
def test_our_changelog_is_in_the_format_of_catkin(tmp_path: Path) -> None:
    changelog = pytest.importorskip("catkin_pkg.changelog")
    pytest.importorskip("docutils")
    text = (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")
    if "\nForthcoming\n" in text:
        text = RELEASE["released"](text, "999.0.0", DAY)
    (tmp_path / "CHANGELOG.rst").write_text(text, encoding="utf-8")
    found = changelog.get_changelog_from_path(str(tmp_path / "CHANGELOG.rst"), "radcam_depth_ros")
    versions = [version for version, _, _ in found.foreach_version()]
    assert versions
    assert all(found.get_content_of_version(version) for version in versions)


def test_each_file_with_the_version_is_written() -> None:
    version = radcam_depth_ros.__version__
    for name in RELEASE["WRITTEN"]:
        if name != "CHANGELOG.rst":
            assert re.search(rf"\b{re.escape(version)}\b", (ROOT / name).read_text(encoding="utf-8")), name


def files_of(project: Path, command: str, monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """The weight files that setuptools takes into a build by this command."""
    arguments: dict[str, Any] = {}
    monkeypatch.chdir(project)
    monkeypatch.setattr(setuptools, "setup", arguments.update)
    runpy.run_path(str(project / "setup.py"), run_name="__main__")
    distribution = setuptools.Distribution(arguments)
    distribution.commands = [command]
    building: Any = distribution.get_command_obj("build_py")
    building.ensure_finalized()
    found = {Path(name).name for _, _, _, names in building.data_files for name in names}
    return {name for name in found if name.endswith((".safetensors", "LICENSE"))}


def test_the_wheel_has_the_weights_of_the_default_network_and_the_other_the_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = {path.stem for path in (ROOT / "radcam_depth_ros" / "weights").glob("*.safetensors")}
    one = files_of(ROOT, "bdist_wheel", monkeypatch)
    assert one == {"LICENSE", "baff.safetensors"}
    assert files_of(ROOT / "release" / "weights", "bdist_wheel", monkeypatch) == {
        "LICENSE",
        *(f"{name}.safetensors" for name in names - {"baff"}),
    }
    for command in ("install", "develop", "editable_wheel", "build"):  # colcon's, and those of an editable install
        assert files_of(ROOT, command, monkeypatch) == {"LICENSE", *(f"{name}.safetensors" for name in names)}


def test_weights_are_found_in_the_other_wheel_and_missed_with_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own, more = tmp_path / "weights", tmp_path / "more" / archive.MORE_WEIGHTS.replace("-", "_")
    own.mkdir()
    more.mkdir(parents=True)
    for path in (ROOT / "radcam_depth_ros" / "weights").iterdir():
        if path.suffix == ".yaml" or path.stem == "baff":
            (own / path.name).symlink_to(path)
        if path.stem != "baff":
            (more / path.name).symlink_to(path)
    monkeypatch.setattr(archive.importlib.resources, "files", lambda _: tmp_path)
    with pytest.raises(archive.ArchiveError, match="radcam-depth-weights==") as caught:
        archive.load("structured")
    assert "\n" not in str(caught.value)
    with pytest.raises(archive.ArchiveError, match="radcam-depth train --network cafnet"):
        archive.load("cafnet")
    monkeypatch.syspath_prepend(more.parent)
    assert archive.load("structured").card.network == "structured"
    assert archive.shipped("baff").parent == own
