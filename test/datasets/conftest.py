"""A small data set in the schema of nuScenes, written once."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from surround_drive import SurroundDrive, write_surround_drive

from radcam_depth_ros.datasets import export_nuscenes

DRIVES = (
    SurroundDrive(0, cameras=("front", "back"), radars=("front", "front_left", "back_right")),
    SurroundDrive(1, scenario=(("weather", "rain"), ("time_of_day", "night")), empty_sweep=4),
    SurroundDrive(2, radars=("front", "back_left")),
)
VERSION = "v1.0-mini"


@pytest.fixture(scope="session")
def surround_drives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    folder = tmp_path_factory.mktemp("surround")
    return tuple(write_surround_drive(folder / f"{drive.seed}.mcap", drive) for drive in DRIVES)


@pytest.fixture(scope="session")
def whole_set(surround_drives: tuple[Path, ...], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three scenes; not to be changed."""
    root = tmp_path_factory.mktemp("nuscenes") / "set"
    export_nuscenes(surround_drives, root)
    return root


@pytest.fixture
def dataset(whole_set: Path, tmp_path: Path) -> Path:
    """A copy that may be damaged."""
    return Path(shutil.copytree(whole_set, tmp_path / "set"))


@pytest.fixture
def edit_table(dataset: Path) -> Callable[[str, Callable[[list[dict[str, object]]], None]], None]:
    """Changes the rows of a table: `edit_table("ego_pose", lambda rows: rows.pop())`."""
    import json

    def edit(name: str, change: Callable[[list[dict[str, object]]], None]) -> None:
        path = dataset / VERSION / f"{name}.json"
        rows = json.loads(path.read_text())
        change(rows)
        path.write_text(json.dumps(rows))

    return edit
