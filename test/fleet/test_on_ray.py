"""The same drives as tasks of Ray, on a cluster of two nodes of which one is killed on the way."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from command_line import run_main
from fleet.numbering import Numbering
from fleet.test_kills import results

from radcam_depth_ros.fleet import on_ray
from radcam_depth_ros.fleet.engines import engine_of
from radcam_depth_ros.fleet.errors import FleetError
from radcam_depth_ros.fleet.results import open_results
from radcam_depth_ros.fleet.running import run
from radcam_depth_ros.fleet.unit import units_of
from radcam_depth_ros.storage import find_places

ray: Any = pytest.importorskip("ray", reason="the extra fleet is not installed")
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::FutureWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def cluster(s3_server: object) -> Iterator[Any]:
    """Two nodes with a core each, on this computer, which reach the tests' storage."""
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(ROOT / "test")]))
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        patch.setenv("OMP_NUM_THREADS", "1")
        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "object_store_memory": 10**8})
        cluster.add_node(num_cpus=1, object_store_memory=10**8)
        patch.setenv("RAY_ADDRESS", cluster.address)
        try:
            yield cluster
        finally:
            ray.shutdown()
            cluster.shutdown()


def files(folder: Path, count: int) -> list[str]:
    folder.mkdir(exist_ok=True)
    for index in range(count):
        (folder / f"{index:02}.mcap").write_bytes(b"x" * (index + 1))
    return [str(path) for path in sorted(folder.iterdir())]


@pytest.mark.usefixtures("cluster")
def test_drives_are_done_on_the_cluster_and_bad_ones_named(tmp_path):
    places = files(tmp_path / "drives", 6)
    Path(places[2]).write_bytes(b"bad")
    units = units_of(places)
    for kept in (0, 5):
        summary = run(Numbering(str(tmp_path / "log")), units, str(tmp_path / "out"), None, engine_of("ray"))
        assert (summary.kept, summary.failed) == (kept, 1)
    values = [summary.results.result(unit) for unit in units]
    assert [value and value["value"] for value in values] == [1, 2, None, 4, 5, 6]


@pytest.mark.usefixtures("cluster")
def test_a_node_of_another_version_is_refused(monkeypatch):
    monkeypatch.setattr(on_ray, "__version__", "9.9")
    with pytest.raises(FleetError, match=r"expected version 9\.9 of radcam_depth_ros with Python"):
        engine_of("ray")


@pytest.mark.usefixtures("cluster")
def test_a_node_with_another_python_is_refused(monkeypatch):
    monkeypatch.setattr(on_ray.platform, "python_version_tuple", lambda: ("3", "99", "0"))
    with pytest.raises(FleetError, match=r"with Python 3\.99 on the node .*, got \S+ with Python 3\.\d+; install the"):
        engine_of("ray")


@pytest.mark.usefixtures("cluster")
def test_a_driver_that_is_killed_loses_nothing_and_repeats_nothing(tmp_path):
    """Finished drives stay; of those that were in work, at most as many are done again as may wait."""
    folder, out, log = tmp_path / "drives", tmp_path / "out", tmp_path / "log"
    files(folder, 24)
    command = [sys.executable, str(Path(__file__).with_name("counting_run.py")), folder, out, log, "0.1", "ray"]
    finished = set[str]()
    for _ in range(3):
        process = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(ROOT)}, cwd=tmp_path)
        deadline = time.monotonic() + 60
        while process.poll() is None and len(results(out)) < len(finished) + 4 and time.monotonic() < deadline:
            time.sleep(0.001)
        process.kill()
        process.wait()
        assert finished < results(out)
        finished = results(out)
    before = Counter(log.read_text(encoding="utf-8").split())
    units = units_of([str(path) for path in sorted(folder.iterdir())])
    summary = run(Numbering(str(log)), units, str(out), None, engine_of("ray"))
    assert summary.kept == len(finished)
    after = Counter(log.read_text(encoding="utf-8").split())
    assert all(after[name] == before[name] for name in finished)
    assert sum(after.values()) <= 24 + 3 * 2 * 2
    assert [open_results(str(out)).result(unit)["value"] for unit in units] == list(range(1, 25))


@pytest.mark.usefixtures("cluster")
def test_drives_and_results_are_in_storage(tmp_path, s3):
    system, _ = s3
    system.pipe({f"fleet/drives/{index}.mcap": b"x" * (index + 1) for index in range(4)})
    units = units_of(find_places(["s3://fleet/drives"]))
    for kept in (0, 4):
        summary = run(Numbering(str(tmp_path / "log")), units, "s3://fleet/results", None, engine_of("ray"))
        assert (summary.kept, summary.failed) == (kept, 0)
    assert [summary.results.result(unit)["value"] for unit in units] == [1, 2, 3, 4]


@pytest.mark.usefixtures("cluster")
def test_a_drive_that_kills_its_workers_fails_alone(tmp_path):
    places = files(tmp_path / "drives", 3)
    Path(places[1]).write_bytes(b"die")
    summary = run(Numbering(str(tmp_path / "log")), units_of(places), str(tmp_path / "out"), None, engine_of("ray"))
    assert summary.failed == 1
    assert "its worker died again and again" in summary.results.failures()[places[1]]


@pytest.mark.usefixtures("loaded")
def test_a_cluster_that_loses_a_node_gives_what_one_process_gives(tmp_path, cluster, write_truth, monkeypatch, capsys):
    for seed in range(6):
        write_truth(tmp_path / "drives" / f"{seed}.mcap", seed)
    assert run_main(monkeypatch, "evaluate", tmp_path / "drives", "--json", "-") == 0
    whole = json.loads(capsys.readouterr().out)
    node = next(node for node in cluster.list_all_nodes() if not node.head)
    outcomes = on_ray._outcomes

    def losing(*arguments):
        for index, outcome in enumerate(outcomes(*arguments)):
            if index == 1:
                cluster.remove_node(node, allow_graceful=False)
            yield outcome

    monkeypatch.setattr(on_ray, "_outcomes", losing)
    asked = ("evaluate", tmp_path / "drives", "--out", tmp_path / "out", "--on", "ray", "--json", "-")
    assert run_main(monkeypatch, *asked) == 0
    merged = json.loads(capsys.readouterr().out)
    for plain in (whole, merged):
        plain.pop("latency_ms")
    assert merged == whole


def test_a_cluster_that_does_not_answer_is_one_sentence():
    with pytest.raises(FleetError, match=r"cannot join the Ray cluster ray://127\.0\.0\.1:9"):
        engine_of("ray://127.0.0.1:9")
