from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from radcam_depth_ros.engine import load
from radcam_depth_ros.engine.load import Load, usable_cores

TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")
STAT = """\
cpu  900 900 900 900 900 900 900 900 900 900
cpu0 {user} 2 3 4000 5000 6 7 8 90 10
cpu1 100 0 0 0 0 0 0 0 0 0
cpu12 1000 0 0 0 0 0 0 0 0 0
intr 12345 6 7
ctxt 98765
"""
Write = Callable[[str, str], None]


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Write:
    """Writes a file of the system, such as `proc/stat`; the process may use cores 0 to 7."""
    monkeypatch.setattr(load, "PROC", tmp_path / "proc")
    monkeypatch.setattr(load, "CGROUP", tmp_path / "cgroup")
    allow(monkeypatch, *range(8))

    def put(name: str, text: str) -> None:
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")

    return put


def allow(monkeypatch: pytest.MonkeyPatch, *cores: int) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(cores), raising=False)


@pytest.fixture(autouse=True)
def _usual_priority(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever starts the tests may be nice."""
    monkeypatch.setattr(os, "getpriority", lambda which, who: 0)


@pytest.mark.parametrize(("priority", "low"), [(0, 0), (10, 2)])
def test_busy_counts_all_but_idle_disk_guests_and_what_gives_way(
    write: Write, monkeypatch: pytest.MonkeyPatch, priority: int, low: int
) -> None:
    """User, system, two kinds of interrupts and what the host took (steal); nice to a process that is nice itself."""
    monkeypatch.setattr(os, "getpriority", lambda which, who: priority)
    allow(monkeypatch, 0)
    write("proc/stat", STAT.format(user=100))
    assert Load.now().busy_s == pytest.approx((100 + low + 3 + 6 + 7 + 8) / TICKS_A_SECOND)


@pytest.mark.parametrize(("cores", "ticks"), [((0,), 24), ((1,), 100), ((0, 1), 124), ((0, 1, 12), 1124)])
def test_busy_counts_allowed_cores_alone(
    write: Write, monkeypatch: pytest.MonkeyPatch, cores: tuple[int, ...], ticks: int
) -> None:
    allow(monkeypatch, *cores)
    write("proc/stat", STAT.format(user=0))
    assert Load.now().busy_s == pytest.approx(ticks / TICKS_A_SECOND)


def test_busy_is_not_told_where_the_allowed_cores_are_not_listed(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    """A container may number its cores anew."""
    allow(monkeypatch, 4, 5)
    write("proc/stat", STAT.format(user=0))
    assert math.isnan(Load.now().busy_s)


def test_waited_is_of_all_threads(write: Write) -> None:
    write("proc/self/task/10/schedstat", "7000000000 1500000000 40\n")
    write("proc/self/task/11/schedstat", "9000000000 250000000 50\n")
    write("proc/self/task/12/schedstat", "")  # a thread that has just ended
    assert Load.now().waited_s == pytest.approx(1.75)


def test_what_is_not_there_is_not_told(write: Write) -> None:
    now = Load.now()
    assert math.isnan(now.busy_s)
    assert math.isnan(now.waited_s)
    assert math.isfinite(now.at_s)
    assert math.isfinite(now.own_s)
    assert usable_cores() == 8


def test_without_affinity_all_cores_count(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    assert usable_cores() == 3


@pytest.mark.parametrize(
    ("quota", "cores"),
    [
        ("max 100000", 8),
        ("100000 100000", 1),
        ("150000 100000", 2),
        ("240000 100000", 2),
        ("20000 100000", 1),
        ("1600000 100000", 8),
        ("0 100000", 8),
        ("", 8),
    ],
)
def test_quota_of_version_2(write: Write, quota: str, cores: int) -> None:
    write("proc/self/cgroup", "0::/\n")
    write("cgroup/cpu.max", f"{quota}\n")
    assert usable_cores() == cores


@pytest.mark.parametrize(("quota_us", "cores"), [("-1", 8), ("150000", 2), ("400000", 4)])
@pytest.mark.parametrize("controllers", ["cpu", "cpu,cpuacct"])
def test_quota_of_version_1(write: Write, controllers: str, quota_us: str, cores: int) -> None:
    write("proc/self/cgroup", f"12:memory:/\n4:{controllers}:/\n1:name=systemd:/\n0::/\n")
    write("cgroup/cpu/cpu.cfs_quota_us", f"{quota_us}\n")
    write("cgroup/cpu/cpu.cfs_period_us", "100000\n")
    assert usable_cores() == cores


@pytest.mark.parametrize(("of_service", "of_slice", "cores"), [("300000", "max", 3), ("max", "200000", 2)])
def test_quota_of_a_service_and_of_what_it_is_in(write: Write, of_service: str, of_slice: str, cores: int) -> None:
    write("proc/self/cgroup", "0::/robot.slice/depth.service\n")
    write("cgroup/robot.slice/cpu.max", f"{of_slice} 100000\n")
    write("cgroup/robot.slice/depth.service/cpu.max", f"{of_service} 100000\n")
    write("cgroup/robot.slice/other.service/cpu.max", "100000 100000\n")
    assert usable_cores() == cores


def test_a_container_that_sees_its_own_group_as_the_root(write: Write) -> None:
    write("proc/self/cgroup", "4:cpu,cpuacct:/docker/0123abcd\n")
    write("cgroup/cpu/cpu.cfs_quota_us", "250000\n")
    write("cgroup/cpu/cpu.cfs_period_us", "50000\n")
    assert usable_cores() == 5


def test_affinity_below_the_quota(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    allow(monkeypatch, 2, 5)
    write("proc/self/cgroup", "0::/\n")
    write("cgroup/cpu.max", "500000 100000\n")
    assert usable_cores() == 2


def test_this_machine_tells_times_that_do_not_go_back() -> None:
    first, second = Load.now(), Load.now()
    for name in ("at_s", "own_s"):
        assert math.isfinite(getattr(first, name))
    for name in ("at_s", "busy_s", "own_s"):
        # Not told is allowed: the machine may be any.
        assert not getattr(second, name) < getattr(first, name)
    assert 1 <= usable_cores() <= (os.cpu_count() or 1)
