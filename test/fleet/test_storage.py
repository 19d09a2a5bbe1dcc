"""Drives and results in object storage: moto's S3 server on loopback, with reads that fail and stall."""

from __future__ import annotations

import itertools
import json
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from command_line import run_main
from fleet.numbering import Numbering

from radcam_depth_ros.fleet import storage
from radcam_depth_ros.fleet.errors import FleetError
from radcam_depth_ros.fleet.running import run
from radcam_depth_ros.fleet.storage import find_places, place_of
from radcam_depth_ros.fleet.unit import units_of

pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


class Faulty:
    """Every n-th GET of an object fails, in turns by an answer and by a stall; writes to `readonly` are forbidden."""

    def __init__(self, application: Any) -> None:
        self._application, self._count = application, itertools.count(1)
        self.every, self.stall_s, self.failed = 0, 1.0, 0

    def __call__(self, environment: Any, start: Any) -> Any:
        path, method = environment["PATH_INFO"], environment["REQUEST_METHOD"]
        if method == "PUT" and path.startswith("/readonly/"):
            start("403 Forbidden", [("Content-Type", "application/xml")])
            return [b"<Error><Code>AccessDenied</Code><Message>Access Denied</Message></Error>"]
        if self.every and method == "GET" and path.endswith(".mcap") and not next(self._count) % self.every:
            self.failed += 1
            if self.failed % 2:
                time.sleep(self.stall_s)
            start("403 Forbidden" if path.endswith("never.mcap") else "500 Internal Server Error", [])
            return [b""]
        return self._application(environment, start)


@pytest.fixture
def s3(monkeypatch):
    pytest.importorskip("s3fs", reason="the extra fleet is not installed")
    pytest.importorskip("moto", reason="pip install moto[server]")
    from moto.server import DomainDispatcherApplication, create_backend_app
    from werkzeug.serving import make_server

    faulty = Faulty(DomainDispatcherApplication(create_backend_app))
    server = make_server("127.0.0.1", 0, faulty, threaded=True)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    for name, value in {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{server.server_port}",
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_CONFIG_FILE": "/dev/null",
        "AWS_EC2_METADATA_DISABLED": "true",
    }.items():
        monkeypatch.setenv(name, value)
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    system, _ = storage._system("s3://fleet")
    for bucket in ("fleet", "readonly"):
        if not system.exists(bucket):
            system.mkdir(bucket)
    system.invalidate_cache()
    yield system, faulty
    if system.exists("fleet/"):
        system.rm("fleet", recursive=True)
    s3fs.S3FileSystem.clear_instance_cache()
    server.shutdown()
    thread.join()


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
    with pytest.raises(FleetError, match=r"cannot write s3://readonly/r/plan\.json: .*credentials"):
        run(Numbering(str(tmp_path / "log")), units, "s3://readonly/r")
    with pytest.raises(FleetError, match="there is no bag at s3://fleet/none"):
        find_places(["s3://fleet/none"])
    with pytest.raises(FleetError, match="cannot reach nowhere://a"):
        find_places(["nowhere://a"])
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name)
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", "/dev/null")
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    with pytest.raises(FleetError, match="credentials"):
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


def test_a_place_keeps_its_two_slashes():
    assert place_of(Path("s3://bucket/a b")) == place_of("s3://bucket/a b") == "s3://bucket/a b"
    assert place_of(Path("/drives/a")) == "/drives/a"
