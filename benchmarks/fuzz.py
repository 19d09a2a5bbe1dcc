"""Wrong messages by the thousand through the road from messages to depth, and a good pair every so often.

Run it from the repository's root: `python -m benchmarks.fuzz --messages 100000 --seed 1`, with `--json FILE` for the
figures. Messages of all types that the node reads, see `fuzz_messages`, go where its callbacks put them: only the
project's own errors may come out, in sentences of bounded length, frames hold finite numbers, memory stays, and each
good pair gives the depth that it gives alone. Anything else is a defect; the exit status is 1 then. numpy's warnings
count as errors. A message is made of the seed and its number alone: the table says how to repeat each defect, where it
needs no message before it.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks import fuzz_messages
from benchmarks.fuzz_messages import (
    CAMERA,
    CAMERA_FROM_RADAR,
    CAMERA_INFO,
    DYNAMIC,
    IMAGE,
    ODOMETRY,
    RADAR,
    RETURNS,
    STATIC,
)
from benchmarks.memory import memory_mib
from radcam_depth_ros.cli.terminal.options import progress_bar, write_json
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.frame import LONGEST_SENTENCE, FloatArray, Frame, RadcamDepthError
from radcam_depth_ros.frame_builder import FrameBuilder, FrameBuilderConfig

_START_NS = 1_000_000_000_000
_PERIOD_NS = 5_000_000
_PAUSE_NS = 3_000_000_000
_DEFECTS_KEPT = 50
_BY_ODOMETRY = FrameBuilderConfig(
    image=IMAGE,
    camera_info=CAMERA_INFO,
    radars=(RADAR,),
    radar_motion_compensation=True,
    odometry=ODOMETRY,
    without_radar="hold",
)
CONFIGS = (_BY_ODOMETRY, replace(_BY_ODOMETRY, odometry="", without_radar="camera_only"))
"""Motion from odometry, and from /tf."""


@dataclass(frozen=True)
class Defect:
    """What should not have come out.

    Attributes:
        number: Of the message.
        kind: Of the message.
        problem: What came out.
        repeat: The command that sends the same message alone.
        trace: Where it came from.
    """

    number: int
    kind: str
    problem: str
    repeat: str
    trace: str = ""


@dataclass
class Figures:
    """What came of the messages.

    Attributes:
        messages: How many there were.
        seed: What they were made of.
        kinds: How many of each kind were taken and refused.
        frames: That came out of wrong messages.
        frames_refused: Of these, how many the network could not be given.
        good_pairs: How many were sent.
        pairs_needed: How many it took until the depth was right: 1 each time, unless one was lost.
        slowest_ms: The message that took longest, and its kind.
        memory_mib: Resident memory after a tenth of the messages and after all.
        defects: The first of each place.
        defects_in_all: How many came out.
    """

    messages: int
    seed: int
    kinds: dict[str, dict[str, int]] = field(default_factory=dict)
    frames: int = 0
    frames_refused: int = 0
    good_pairs: int = 0
    pairs_needed: dict[int, int] = field(default_factory=dict)
    slowest_ms: tuple[float, str] = (0.0, "")
    memory_mib: tuple[float, float] = (0.0, 0.0)
    defects: list[Defect] = field(default_factory=list)
    defects_in_all: int = 0


class Fuzz:
    """Sends wrong messages, and good ones in between.

    Args:
        estimator: For the good pairs, and to prepare what frames come of wrong ones.
        seed: What the messages are made of.
        good_every: So many wrong messages go before a good pair.
    """

    def __init__(self, estimator: Estimator, seed: int, good_every: int = 500) -> None:
        self._estimator, self._seed, self._good_every = estimator, seed, good_every
        self._now_ns, self._number = _START_NS, 0
        self._counts: Counter[tuple[str, bool]] = Counter()
        self._places: set[str] = set()
        self.figures = Figures(0, seed)
        self._builders = [FrameBuilder(config) for config in CONFIGS]
        self._expected: FloatArray = np.zeros(0, np.float32)
        for builder in self._builders:
            (frame,) = self._send_pair(builder)
            self._expected = estimator.estimate(frame).dense

    def run(self, messages: int, first: int = 0, done: Callable[[int], None] = lambda number: None) -> Figures:
        """Sends messages from a number on; returns what came of all so far."""
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for number in range(first, first + messages):
                self.send(number)
                if (number + 1 - first) % self._good_every == 0 or number + 1 == first + messages:
                    self.recover()
                if number - first == messages // 10:
                    self.figures.memory_mib = (memory_mib("VmRSS"), 0.0)
                done(number + 1 - first)
        self.figures.messages += messages
        self.figures.memory_mib = (self.figures.memory_mib[0], memory_mib("VmRSS"))
        kinds = sorted({kind for kind, _ in self._counts})
        self.figures.kinds = {
            kind: {"taken": self._counts[kind, True], "refused": self._counts[kind, False]} for kind in kinds
        }
        return self.figures

    def send(self, number: int) -> tuple[str, bool]:
        """Sends a message, or a few that belong together; returns their kinds, and whether one was refused."""
        self._number = number
        rng = random.Random(f"{self._seed}/{number}")
        builder, kinds, is_refused = rng.choice(self._builders), [], False
        for sent in fuzz_messages.bad(rng, self._now_ns):
            kinds.append(sent.kind)
            self._now_ns += _PERIOD_NS
            started = time.perf_counter()
            try:
                frames = self._guarded(number, sent.kind, partial(builder.add, sent.topic, sent.message, self._now_ns))
            except RadcamDepthError:
                self._counts[sent.kind, False] += 1
                frames, is_refused = (), True
            else:
                self._counts[sent.kind, True] += 1
            took_ms = 1e3 * (time.perf_counter() - started)
            self.figures.slowest_ms = max(self.figures.slowest_ms, (took_ms, f"{sent.kind}, number {number}"))
            self._prepare(number, sent.kind, frames or ())
        try:
            self._prepare(
                number, "waiting images", self._guarded(number, "", lambda: builder.expire(self._now_ns)) or ()
            )
        except RadcamDepthError:
            self._counts["waiting images", False] += 1
        return ", ".join(kinds), is_refused

    def recover(self) -> None:
        """Sends good pairs after the last message, and notes what is wrong with their depth."""
        for builder in self._builders:
            self._recover(builder, self._number)

    def _prepare(self, number: int, kind: str, frames: tuple[Frame, ...]) -> None:
        for frame in frames:
            self.figures.frames += 1
            if not np.isfinite(frame.radar.age_s).all() or np.isinf(frame.radar.rcs_dbsm).any():
                self._note(number, kind, "a frame with ages or cross sections that are not finite")
            try:
                inputs = self._guarded(number, f"{kind}, prepared", partial(self._estimator.prepare, frame))
            except RadcamDepthError:
                self.figures.frames_refused += 1
                continue
            if inputs is not None and not np.isfinite(inputs.radar[:, :3]).all():
                self._note(number, kind, "radar columns that are not finite")

    def _guarded(self, number: int, kind: str, call: Callable[[], Any]) -> Any:
        """The call's value; None after a defect, which is noted."""
        try:
            return call()
        except RadcamDepthError as error:
            if not 10 < len(str(error)) <= LONGEST_SENTENCE:
                self._note(number, kind, f"a sentence of {len(str(error))} characters: {str(error)[:80]}")
            raise
        except Exception as error:
            self._note(number, kind, f"{type(error).__name__}: {str(error)[:200]}", traceback.format_exc())
        return None

    def _note(self, number: int, kind: str, problem: str, trace: str = "") -> None:
        self.figures.defects_in_all += 1
        place = "".join(line for line in trace.splitlines() if "File" in line) or problem.split(":")[0]
        if place in self._places or len(self.figures.defects) >= _DEFECTS_KEPT:
            return
        self._places.add(place)
        repeat = f"python -m benchmarks.fuzz --seed {self._seed} --first {number} --messages 1"
        self.figures.defects.append(Defect(number, kind, problem, repeat, trace))

    def _recover(self, builder: FrameBuilder, number: int) -> None:
        """Sends good pairs until one gives the depth that it gives alone."""
        for count in range(1, 4):
            self.figures.good_pairs += 1
            problem = self._problem_of_pair(builder, number)
            if not problem:
                self.figures.pairs_needed[count] = self.figures.pairs_needed.get(count, 0) + 1
                return
            if count == 1:
                self._note(number, "good pair", problem)

    def _problem_of_pair(self, builder: FrameBuilder, number: int) -> str:
        try:
            frames = self._guarded(number, "good pair", lambda: self._send_pair(builder))
        except RadcamDepthError as error:
            return f"a good pair was refused: {error}"
        found = [frame for frame in frames or () if frame.stamp_ns == self._now_ns]
        if not found:
            return "a good pair gave no frame"
        frame = found[0]
        if frame.camera != CAMERA or frame.lens is not None:
            return f"a good pair's frame has another camera, {frame.camera} {frame.lens}"
        expected = CAMERA_FROM_RADAR.apply(RETURNS)
        if frame.radar.xyz_m.shape != expected.shape or not np.allclose(frame.radar.xyz_m, expected, atol=1e-4):
            return f"a good pair's frame has other returns, {frame.radar.xyz_m.tolist()}"
        if not np.allclose(self._estimator.estimate(frame).dense, self._expected, rtol=1e-3, atol=1e-3):
            return "a good pair's depth differs"
        return ""

    def _send_pair(self, builder: FrameBuilder) -> tuple[Frame, ...]:
        """Sends all that a depth image takes, a while after what came before."""
        while True:  # what waits comes out with its error
            try:
                if not builder.expire(self._now_ns + _PAUSE_NS):
                    break
            except RadcamDepthError:
                continue
        self._now_ns += _PAUSE_NS
        sweep_ns = self._now_ns - 20_000_000
        frames: tuple[Frame, ...] = ()
        for topic, stamp_ns in (
            (STATIC, sweep_ns),
            (DYNAMIC, sweep_ns),
            (DYNAMIC, self._now_ns),
            *((ODOMETRY, sweep_ns + offset_ns) for offset_ns in (-60_000_000, 0, 20_000_000)),
            (CAMERA_INFO, self._now_ns),
            (RADAR, sweep_ns),
            (IMAGE, self._now_ns),
        ):
            frames += builder.add(topic, fuzz_messages.good(topic, stamp_ns), self._now_ns)
        return frames + builder.expire(self._now_ns + 200_000_000)


def print_figures(figures: Figures, console: Console) -> None:
    """Prints tables of what came out."""
    table = Table("kind", "taken", "refused")
    for kind, counts in figures.kinds.items():
        table.add_row(kind, str(counts["taken"]), str(counts["refused"]))
    console.print(table)
    growth = figures.memory_mib[1] - figures.memory_mib[0]
    console.print(
        f"{figures.messages} messages; {figures.frames} frames of wrong messages, {figures.frames_refused} of them "
        f"refused by the network\n{figures.good_pairs} good pairs; how many it took, and how often: "
        f"{figures.pairs_needed}\nslowest {figures.slowest_ms[0]:.1f} ms ({figures.slowest_ms[1]})\nmemory "
        f"{figures.memory_mib[1]:.0f} MiB, {growth:+.1f} MiB since a tenth of the messages\n"
        f"{figures.defects_in_all} defects in {len(figures.defects)} places"
    )
    for defect in figures.defects:
        console.print(f"{defect.number} {defect.kind}: {defect.problem}\n  {defect.repeat}", markup=False)


def main() -> None:
    """Sends, and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--messages", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first message")
    parser.add_argument("--good-every", type=int, default=500, help="wrong messages before each good pair")
    parser.add_argument("--network", default="baff", help="a network whose weights come with the package")
    parser.add_argument("--json", help="write the figures as JSON to a file, - for stdout")
    options = parser.parse_args()
    fuzz = Fuzz(Estimator(EstimatorConfig(network=options.network)), options.seed, options.good_every)
    with progress_bar() as progress:
        bar = progress.add_task("messages", total=options.messages)
        figures = fuzz.run(options.messages, options.first, lambda done: progress.update(bar, completed=done))
    print_figures(figures, Console(stderr=True))
    if options.json:
        write_json(asdict(figures), options.json)
    sys.exit(1 if figures.defects else 0)


if __name__ == "__main__":
    main()
