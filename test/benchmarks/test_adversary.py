from __future__ import annotations

import json
import shutil
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from dying_attack import KEPT, KILLED, LEFT, MADE, RAISED, TOLD, DyingAttack

from benchmarks.adversary import __main__ as adversary
from benchmarks.adversary.archives import ArchiveAttack
from benchmarks.adversary.bags import BagAttack
from benchmarks.adversary.cases import Attack, Place
from benchmarks.adversary.good_files import write_good
from benchmarks.adversary.kills import KillAttack
from benchmarks.adversary.messages import MessageAttack
from benchmarks.adversary.workers import Report, run_cases


@pytest.fixture(scope="module")
def good_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good")
    write_good(folder)
    return folder


@pytest.fixture
def place(good_files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Place]:
    """A place in this process, which keeps its own folder and output."""
    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(sys, "argv", sys.argv)
    for verb in ("replay", "evaluate"):
        module = sys.modules[f"radcam_depth_ros.cli.{verb}"]
        monkeypatch.setattr(module, "load_estimator", vars(module)["load_estimator"])
    place = Place(tmp_path / "place")
    for file in good_files.iterdir():
        shutil.copy(file, place.kept)
    yield place
    signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize(("make", "count"), [(ArchiveAttack, 15), (BagAttack, 5), (MessageAttack, 100)])
def test_a_small_share_holds(make: type[Attack], count: int, place: Place) -> None:
    attack = make(7, place)  # type: ignore[call-arg]
    for number in range(count):
        place.clear()
        assert attack.run(number).problems == ()
    assert attack.good() == ()


@pytest.mark.exhaustive
def test_a_verb_that_is_killed_and_one_on_a_disk_that_ends_hold(place: Place) -> None:
    attack = KillAttack(0, place)
    attack.verbs = {"inspect": attack.verbs["inspect"]}  # the quickest
    outcomes = [attack.run(number) for number in (0, 1)]
    assert [outcome.what for outcome in outcomes] == ["inspect, SIGKILL", "inspect, full disk"]
    assert [outcome.problems for outcome in outcomes] == [(), ()]


def test_what_should_not_happen_is_told_for_each_case(tmp_path: Path) -> None:
    reports: list[Report] = []
    run_cases(DyingAttack, range(6), 0, tmp_path / "workers", 1, reports.append)
    told = {number: [p for r in reports if r.number == number for p in r.outcome.problems] for number in range(6)}
    assert told[KEPT] == []
    assert told[MADE] == ["bystander.txt was removed", "here/made was made"]
    assert told[TOLD][0].startswith("a traceback: ")
    assert "control characters" in told[TOLD][1]
    assert "the attack itself failed: KeyError: 'oh'" in told[RAISED][0]
    assert "took the process down with SIGSEGV" in told[KILLED][0]
    assert told[LEFT] == [f"{tmp_path / 'elsewhere'} was opened for writing", "the good one after it: another depth"]


def test_a_case_can_be_repeated_and_the_exit_status_says_whether_all_held(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(adversary.KINDS, "bags", adversary.Kind(DyingAttack, 6, "cases", needs_weights=False))
    target = tmp_path / "figures.json"
    assert adversary.main(["--only", "bags", "--case", str(KEPT), "--workers", "1"]) == 0
    assert adversary.main(["--only", "bags", "--case", str(TOLD), "--seed", "3", "--json", str(target)]) == 1
    told = capsys.readouterr().err
    assert f"[--only bags --case {TOLD} --seed 3]" in told
    figures = json.loads(target.read_text(encoding="utf-8"))["kinds"]["bags"]
    assert figures["cases"] == 1
    assert [number for number, _ in figures["failures"]] == [TOLD, TOLD]


def test_a_tenth_is_a_tenth_of_each_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = {}

    def count(kind: str, numbers: range, *_: object) -> adversary.Figures:
        counts[kind] = len(numbers)
        return adversary.Figures()

    monkeypatch.setattr(adversary, "attack", count)
    assert adversary.main(["--share", "0.1"]) == 0
    assert counts == {"archives": 1000, "bags": 200, "messages": 2000, "requests": 250, "kills": 5}
