from __future__ import annotations

import json
import os

import pytest
from fleet.numbering import Numbering

from radcam_depth_ros.files import FileError
from radcam_depth_ros.fleet.errors import FleetError
from radcam_depth_ros.fleet.results import open_results
from radcam_depth_ros.fleet.running import run
from radcam_depth_ros.fleet.shard import Shard
from radcam_depth_ros.fleet.unit import units_of


@pytest.fixture
def files(tmp_path):
    folder = tmp_path / "drives"
    folder.mkdir()
    for index in range(5):
        (folder / f"{index}.mcap").write_bytes(b"x" * (index + 1))
    return folder


def units(folder):
    return units_of([str(path) for path in sorted(folder.iterdir())])


def done(tmp_path):
    log = tmp_path / "log"
    return log.read_text(encoding="utf-8").split() if log.exists() else []


def go(tmp_path, files, shard=None, **settings):
    return run(Numbering(str(tmp_path / "log"), **settings), units(files), str(tmp_path / "out"), shard)


def test_what_is_done_is_kept(tmp_path, files):
    assert go(tmp_path, files, Shard(0, 2)).kept == 0
    assert done(tmp_path) == ["0", "2", "4"]
    assert (go(tmp_path, files).kept, go(tmp_path, files).kept) == (3, 5)
    assert done(tmp_path) == ["0", "2", "4", "1", "3"]
    results = open_results(str(tmp_path / "out"))
    assert [results.result(unit)["value"] for unit in units(files)] == [1, 2, 3, 4, 5]
    assert len(list((tmp_path / "out" / "drives").iterdir())) == 5


def test_a_bag_that_changed_is_done_again_and_one_that_moved_is_not(tmp_path, files):
    go(tmp_path, files)
    (files / "1.mcap").write_bytes(b"another drive")
    os.utime(files / "2.mcap", ns=(1, 1))  # copied: another time, the same content
    files.rename(tmp_path / "moved")
    summary = go(tmp_path, tmp_path / "moved")
    assert (summary.kept, done(tmp_path)[5:]) == (4, ["1"])
    results = open_results(str(tmp_path / "out"))
    assert results.result(units(tmp_path / "moved")[1])["value"] == 13
    assert len(list((tmp_path / "out" / "drives").iterdir())) == 5
    assert go(tmp_path, tmp_path / "moved").kept == 5


def test_a_drive_that_fails_is_named_and_tried_again(tmp_path, files):
    (files / "1.mcap").write_bytes(b"bad")
    (files / "3.mcap").write_bytes(b"bug")
    for _ in range(2):
        summary = go(tmp_path, files)
        assert summary.failed == 2
    lines = (tmp_path / "out" / "failed.jsonl").read_text(encoding="utf-8").splitlines()
    reasons = {entry["drive"]: entry["reason"] for entry in map(json.loads, lines)}
    assert reasons[str(files / "1.mcap")].startswith("expected a good drive")
    assert "ZeroDivisionError" in reasons[str(files / "3.mcap")]
    assert "please report" in reasons[str(files / "3.mcap")]
    for name in ("1", "3"):
        (files / f"{name}.mcap").write_bytes(b"good")
    assert go(tmp_path, files).failed == 0
    assert (tmp_path / "out" / "failed.jsonl").read_text(encoding="utf-8") == ""


def test_a_drive_that_is_gone_is_named(tmp_path, files):
    wanted = units(files)
    (files / "4.mcap").unlink()
    summary = run(Numbering(str(tmp_path / "log")), wanted, str(tmp_path / "out"))
    assert summary.failed == 1
    assert "4.mcap" in next(iter(summary.results.failures().values()))


def test_results_of_other_settings_are_refused(tmp_path, files):
    go(tmp_path, files)
    with pytest.raises(FleetError, match=r"other settings: scale \(1, now 2\); choose another folder"):
        go(tmp_path, files, scale=2)
    assert len(done(tmp_path)) == 5
    plan = tmp_path / "out" / "plan.json"
    plan.write_text(plan.read_text(encoding="utf-8").replace('"version": "', '"version": "9'), encoding="utf-8")
    with pytest.raises(FleetError, match="of version 9"):
        go(tmp_path, files)
    plan.write_text("{}", encoding="utf-8")
    with pytest.raises(FleetError, match="is damaged"):
        go(tmp_path, files)


def test_a_folder_that_cannot_be_written_is_told_before_any_work(tmp_path, files):
    (tmp_path / "out").write_text("a file", encoding="utf-8")
    with pytest.raises(FileError, match="cannot write"):
        go(tmp_path, files)
    assert done(tmp_path) == []


def test_a_result_that_is_damaged_is_made_again(tmp_path, files):
    go(tmp_path, files)
    damaged = sorted((tmp_path / "out" / "drives").iterdir())[2]
    damaged.write_bytes(damaged.read_bytes()[:20])
    assert go(tmp_path, files).kept == 4
    assert done(tmp_path)[5:] == ["2"]


def test_more_drives_may_come_later(tmp_path, files):
    go(tmp_path, files)
    (files / "5.mcap").write_bytes(b"new")
    assert go(tmp_path, files).kept == 5
    assert open_results(str(tmp_path / "out")).plan.drives == tuple(unit.place for unit in units(files))
