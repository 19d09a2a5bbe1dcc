"""Drives and results in object storage: moto's S3 server on loopback, with reads that fail and stall."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import run_main
from fleet.numbering import Numbering

from radcam_depth_ros.fleet.running import run
from radcam_depth_ros.fleet.unit import units_of
from radcam_depth_ros.storage import StorageError, find_places, place_of, transfers
from radcam_depth_ros.training.data import cache
from radcam_depth_ros.training.data.cache import CacheSettings, cached_drives
from radcam_depth_ros.training.data.shared_cache import SharedCache

pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.endurance)])
def test_drives_survive_reads_that_fail_and_stall(tmp_path, s3, count):
    system, faulty = s3
    system.pipe({f"fleet/drives/{index:03}.mcap": b"x" * (index + 1) for index in range(count)})
    faulty.every = 5 if count < 100 else 20
    units = units_of(find_places(["s3://fleet/drives"]))
    assert len(units) == count
    for kept in (0, count):
        summary = run(Numbering(str(tmp_path / "log")), units, "s3://fleet/results")
        assert (summary.kept, summary.failed) == (kept, 0)
    assert faulty.failed
    assert [summary.results.result(unit)["value"] for unit in units] == list(range(1, count + 1))
    assert sorted((tmp_path / "log").read_text(encoding="utf-8").split()) == [unit.name for unit in units]


def test_a_drive_in_storage_that_fails_is_named(tmp_path, s3):
    system, _ = s3
    system.pipe({"fleet/d/0.mcap": b"bad", "fleet/d/1.mcap": b"good"})
    summary = run(Numbering(str(tmp_path / "log")), units_of(find_places(["s3://fleet/d"])), "s3://fleet/r")
    assert summary.failed == 1
    (entry,) = map(json.loads, system.cat_file("fleet/r/failed.jsonl").decode().splitlines())
    assert entry == {
        "drive": "s3://fleet/d/0.mcap",
        "reason": "expected a good drive in s3://fleet/d/0.mcap, got a bad one",
    }


def test_storage_that_cannot_be_used_is_told_before_any_work(tmp_path, s3, monkeypatch):
    system, _ = s3
    system.pipe({"fleet/d/0.mcap": b"good"})
    units = units_of(find_places(["s3://fleet/d"]))
    with pytest.raises(StorageError, match=r"cannot write s3://readonly/r/plan\.json: .*credentials"):
        run(Numbering(str(tmp_path / "log")), units, "s3://readonly/r")
    with pytest.raises(StorageError, match="there is no bag at s3://fleet/none"):
        find_places(["s3://fleet/none"])
    with pytest.raises(StorageError, match="cannot reach nowhere://a"):
        find_places(["nowhere://a"])
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name)
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", "/dev/null")
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    with pytest.raises(StorageError, match="credentials"):
        find_places(["s3://fleet/d"])
    assert not (tmp_path / "log").exists()


@pytest.mark.usefixtures("loaded")
def test_verbs_read_and_write_storage(tmp_path, s3, write_truth, monkeypatch, capsys):
    system, _ = s3
    for seed in range(2):
        system.put_file(str(write_truth(tmp_path / "drives" / f"{seed}.mcap", seed)), f"fleet/drives/{seed}.mcap")
    assert run_main(monkeypatch, "evaluate", tmp_path / "drives", "--json", "-") == 0
    whole = json.loads(capsys.readouterr().out)
    for shard in ("0/2", "1/2"):
        asked = ("evaluate", "s3://fleet/drives", "--out", "s3://fleet/results", "--shard", shard)
        assert run_main(monkeypatch, *asked) == 0
    assert run_main(monkeypatch, "merge", "s3://fleet/results", "--json", "-") == 0
    merged = json.loads(capsys.readouterr().out)
    assert merged["bags"] == ["s3://fleet/drives/0.mcap", "s3://fleet/drives/1.mcap"]
    for plain in (whole, merged):
        del plain["latency_ms"], plain["bags"]
    assert merged == whole
    assert run_main(monkeypatch, "replay", "s3://fleet/drives", "s3://fleet/depth") == 0
    assert {Path(name).name for name in system.ls("fleet/depth", refresh=True)} >= {"0.mcap", "1.mcap"}


def test_samples_are_made_by_many_and_read_by_many(tmp_path, s3, write_truth, monkeypatch):
    """Two jobs prepare samples in storage, of drives in storage; another computer trains and reads no drive."""
    system, _ = s3
    for seed in range(3):
        system.put_file(str(write_truth(tmp_path / f"{seed}.mcap", seed)), f"fleet/bags/{seed}.mcap")
    asked = ("train", "--bags", "s3://fleet/bags", "--cache", "s3://fleet/samples")
    for shard in ("0/2", "1/2"):
        assert run_main(monkeypatch, *asked, "--out", tmp_path / shard[0], "--cache-only", "--shard", shard) == 0
    assert not (tmp_path / "0").exists()
    made = {Path(name).name for name in system.find("fleet/samples") if not name.endswith(".gz")}
    assert made >= {"drive.json", "index.npy", "samples.raw"}

    def unread(*_):
        raise AssertionError("a drive was read whose samples are there")

    monkeypatch.setattr(cache, "read_samples", unread)
    recipe, run = tmp_path / "recipe.yaml", tmp_path / "run"
    recipe.write_text(
        "{iterations: 1, phases: [{share: 1.0, crops: [[64, 64]], batch: 2}], validation: {frames: 1}}",
        encoding="utf-8",
    )
    assert run_main(monkeypatch, *asked, "--out", run, "--processes", 1, "--config", recipe) == 0
    assert (run / "baff.safetensors").is_file()
    assert len(list((run / "cache").glob("*/samples.raw"))) == 3


def test_samples_in_storage_that_are_damaged_are_made_anew(tmp_path, s3, write_truth):
    system, _ = s3
    bag = write_truth(tmp_path / "0.mcap", 0)
    settings, shared = CacheSettings(630.0, 100.0), SharedCache("s3://fleet/samples")
    (first,) = cached_drives([bag], tmp_path / "first", settings, shared=shared)
    (samples,) = system.glob("fleet/samples/*/samples.raw")
    whole = system.cat_file(samples)
    system.pipe_file(samples, whole[:-1])
    (second,) = cached_drives([bag], tmp_path / "second", settings, shared=shared)
    np.testing.assert_array_equal(second[1].image, first[1].image)
    assert system.cat_file(samples) == whole


def test_samples_that_the_disk_has_no_room_for_are_not_fetched(tmp_path, s3, write_truth, monkeypatch):
    bag = write_truth(tmp_path / "0.mcap", 0)
    settings, shared = CacheSettings(630.0, 100.0), SharedCache("s3://fleet/samples")
    cached_drives([bag], tmp_path / "first", settings, shared=shared)
    monkeypatch.setattr(transfers.shutil, "disk_usage", lambda _: SimpleNamespace(free=1 << 20))
    with pytest.raises(StorageError, match=r"s3://fleet/samples/0-\w+ has 0 MB, and .* has room for 0 MB; free some"):
        cached_drives([bag], tmp_path / "second", settings, shared=shared)
    assert not list((tmp_path / "second").iterdir())


def test_a_place_keeps_its_two_slashes():
    assert place_of(Path("s3://bucket/a b")) == place_of("s3://bucket/a b") == "s3://bucket/a b"
    assert place_of(Path("/drives/a")) == "/drives/a"
