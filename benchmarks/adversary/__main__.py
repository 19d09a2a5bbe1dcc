"""Attacks the package with seeded cases, and tells each case in which it did not hold.

    python -m benchmarks.adversary --share 0.1 --seed 1 --json out/adversary.json

Cases run in worker processes, each of which handles many. Every case is judged: no file outside of the outputs is
touched, no output has a traceback, exit codes are as documented, memory stays below 1.5 GB, and what is good gives the
right result afterwards. A case is made of the seed and its number alone: `--only KIND --case N` repeats it. The exit
status is 1 when a case failed.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from benchmarks.adversary.archives import ArchiveAttack
from benchmarks.adversary.bags import BagAttack
from benchmarks.adversary.cases import ROOT, Outcome, tree
from benchmarks.adversary.good_files import write_good
from benchmarks.adversary.kills import KillAttack
from benchmarks.adversary.messages import MessageAttack
from benchmarks.adversary.requests import LONGEST_CALLBACK_MS, RequestAttack
from benchmarks.adversary.workers import Maker, Report, WorkerError, run_cases
from radcam_depth_ros.cli.terminal.options import progress_bar, write_json
from radcam_depth_ros.printable import printable


@dataclass(frozen=True)
class Kind:
    """A kind of cases.

    Attributes:
        make: Makes its attack.
        size: Cases of the whole attack.
        what: What is counted.
        workers: Most workers.
        together: How many make one case.
        needs_weights: Whether its workers need the good weights.
    """

    make: Maker
    size: int
    what: str
    workers: int = 64
    together: int = 1
    needs_weights: bool = True


KINDS = {
    "archives": Kind(ArchiveAttack, 10_000, "weight files"),
    "bags": Kind(BagAttack, 2_000, "bags"),
    "messages": Kind(MessageAttack, 20_000, "messages"),
    "requests": Kind(RequestAttack, 5_000, "requests to a live node, two in each case", workers=1, together=2),
    "kills": Kind(KillAttack, 50, "verbs that are killed or whose disk is full"),
}


@dataclass
class Figures:
    """What came of the cases of a kind.

    Attributes:
        cases: How many ended.
        verdicts: How many of each verdict.
        goods: Good ones in between.
        seconds: Of all cases, one after another.
        slowest_s: The slowest case, and its number.
        peak_mib: Most resident memory, and the case's number.
        failures: Number and problem of each failed case.
        callbacks_ms: The longest callbacks of the live node, by what was called.
    """

    cases: int = 0
    verdicts: dict[str, int] = field(default_factory=dict)
    goods: int = 0
    seconds: float = 0.0
    slowest_s: tuple[float, int] = (0.0, 0)
    peak_mib: tuple[float, int] = (0.0, 0)
    failures: list[tuple[int, str]] = field(default_factory=list)
    callbacks_ms: dict[str, float] = field(default_factory=dict)

    def add(self, report: Report) -> None:
        """Counts a case, or a good one."""
        outcome = report.outcome
        if report.is_good:
            self.goods += 1
        else:
            self.cases += 1
            self.verdicts[outcome.verdict] = self.verdicts.get(outcome.verdict, 0) + 1
            self.seconds += report.seconds
            self.slowest_s = max(self.slowest_s, (round(report.seconds, 2), report.number))
        self.peak_mib = max(self.peak_mib, (round(report.peak_mib), report.number))
        self.failures += [(report.number, f"{outcome.what}: {problem}") for problem in outcome.problems]


def attack(
    kind: str, numbers: Iterable[int], seed: int, folder: Path, workers: int, progress: Progress | None = None
) -> Figures:
    """Runs cases of a kind.

    Args:
        kind: One of `KINDS`.
        numbers: Of the cases.
        seed: What they are made of.
        folder: For the workers; a folder that is not there yet, beside which the good weights are kept.
        workers: Processes that share the cases.
        progress: Shows how far it is, and a line for each failed case.

    Raises:
        WorkerError: when a worker cannot start.
    """
    numbers, figures = list(numbers), Figures()
    bar = progress.add_task(kind, total=len(numbers)) if progress else None

    def told(report: Report) -> None:
        figures.add(report)
        if progress and bar is not None:
            progress.update(bar, completed=figures.cases)
            for problem in report.outcome.problems:
                repeat = f"--only {kind} --case {report.number} --seed {seed}"
                line = printable(f"{kind} {report.number}, {report.outcome.what}: {problem} [{repeat}]")
                progress.console.print(line, markup=False, highlight=False, soft_wrap=True)

    before, kept = _package(), None
    if numbers and KINDS[kind].needs_weights:
        kept = folder.parent / "good"  # made once, since it takes seconds
        kept.mkdir(exist_ok=True)
        write_good(kept)
    run_cases(KINDS[kind].make, numbers, seed, folder, min(workers, KINDS[kind].workers), told, kept)
    if numbers and _package() != before:
        problem = "files of the package itself were changed"
        told(Report(numbers[-1], Outcome("all cases", "failed", (problem,)), 0.0, 0.0, is_good=True))
    figures.callbacks_ms = RequestAttack.longest_ms(folder) if kind == "requests" else {}
    return figures


def _package() -> dict[str, str]:
    files = tree(ROOT / "radcam_depth_ros")
    return {name: entry for name, entry in files.items() if "__pycache__" not in name}


def print_figures(found: dict[str, Figures], console: Console) -> None:
    """Prints a table of all kinds."""
    table = Table("kind", "cases", "what became of them", "good ones", "failed", "slowest", "peak memory")
    for kind, figures in found.items():
        verdicts = ", ".join(f"{count} {name}" for name, count in sorted(figures.verdicts.items()))
        slowest = f"{figures.slowest_s[0]:.1f} s (case {figures.slowest_s[1]})"
        peak = f"{figures.peak_mib[0]:.0f} MiB (case {figures.peak_mib[1]})"
        failed = str(len({number for number, _ in figures.failures}))
        table.add_row(kind, str(figures.cases), verdicts, str(figures.goods), failed, slowest, peak)
    console.print(table)
    for figures in found.values():
        for name, longest_ms in figures.callbacks_ms.items():
            limit = "" if name == "transitions" else f" (limit on an idle machine: {LONGEST_CALLBACK_MS:.0f} ms)"
            console.print(f"longest callback of the live node, {name}: {longest_ms:.0f} ms{limit}")


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, kind in KINDS.items():
        parser.add_argument(f"--{name}", type=int, default=kind.size, help=f"{kind.what} [{kind.size}]")
    parser.add_argument("--share", type=float, default=1.0, help="run this share of all, 0.1 for a tenth [1]")
    parser.add_argument("--seed", type=int, default=0, help="what the cases are made of [0]")
    parser.add_argument("--workers", type=int, default=2, help="processes that share the cases [2]")
    parser.add_argument("--only", choices=KINDS, help="cases of this kind alone")
    parser.add_argument("--case", type=int, help="this case alone, of the kind that --only names")
    parser.add_argument("--json", metavar="FILE", help="write the figures as JSON to a file, - for stdout")
    options = parser.parse_args(arguments)
    if options.case is not None and options.only is None:
        parser.error("--case needs --only KIND")
    return options


def main(arguments: list[str] | None = None) -> int:
    """Attacks, prints, and returns the exit status."""
    options = parse(arguments)
    found: dict[str, Figures] = {}
    folder = Path(tempfile.mkdtemp(prefix="adversary-"))
    try:
        with progress_bar() as progress:
            for kind in KINDS if options.only is None else (options.only,):
                count = int(options.share * getattr(options, kind) / KINDS[kind].together + 0.5)
                numbers = range(count) if options.case is None else (options.case,)
                found[kind] = attack(kind, numbers, options.seed, folder / kind, options.workers, progress)
    except WorkerError as error:
        print(f"adversary: {error}", file=sys.stderr)
        return 1
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    print_figures(found, Console(stderr=True))
    if options.json:
        values: dict[str, Any] = {kind: asdict(figures) for kind, figures in found.items()}
        write_json({"seed": options.seed, "kinds": values}, options.json)
    return 1 if any(figures.failures for figures in found.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
