"""The live node under overload for long: memory, latency, threads and files, and the pairs of each pass over a drive.

    .venv/bin/python -m benchmarks.soak --minutes 30 --json out/soak.json

A small drive is simulated (or `--bag` taken) and played over DDS to a node in a process of its own, again and again,
with `/clock`, so that its stamps jump back each time. First the images come as fast as the node takes them, which
gives its rate; then `--overload` times as fast, so that it must drop some. Each pass ends with a moment's rest, until
the node's diagnostics, which come ten times a second here, account for all images. The exit status is 1 when a target
is missed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rich.console import Console
from rich.table import Table

from benchmarks.node_rate import given_parameters
from benchmarks.soak_figures import CAUSES, Counts, Reading, Round, Soak, read_process
from demo.measure import DEPTH
from demo.plan import Plan, plan_drive
from demo.process import DemoError, NodeProcess, keep_to_this_machine
from demo.session import await_discovery, ros_node, spinning
from radcam_depth_ros import configuration
from radcam_depth_ros.bag_player import PlayedMessage, PlayedTopic, Player
from radcam_depth_ros.bags import BagReader, header_stamp_ns
from radcam_depth_ros.cli.terminal.options import progress_bar, write_json
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.node.latency import LATENCY_TOPICS
from radcam_depth_ros.node.topics.factory import message_class
from radcam_depth_ros.simulation import SimulationConfig, simulate

DRIVE = {
    "world": {"street": "town", "view_m": 120.0},
    "camera": {
        "width": 224,
        "height": 128,
        # Enlarged twice by the node: work for the network, little for DDS and the simulator.
        "min_focal_length_px": 315.0,
        "max_focal_length_px": 315.0,
        "edge_samples": 0,
        "jpeg": False,
        "depth": False,
        "classes": False,
    },
    "imaging_radar": {"enabled": False},
    "lidar": {"enabled": False},
}
SEED = 7
QUEUE_DEPTH = 50
"""Messages of each topic that may wait, so that what the network cannot do is dropped by the node and nowhere else."""
START = """
import sys
from radcam_depth_ros.node import depth_node, main
depth_node.DIAGNOSTICS_PERIOD_S = 0.1
main(sys.argv[1:])
"""
LATENCY = f"/{LATENCY_TOPICS['latency']}"
LISTENED = {
    DEPTH: "sensor_msgs/msg/Image",
    LATENCY: "std_msgs/msg/Float32",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}
FAST = 1000.0
"""Seconds of the drive in one second where images are held back."""
UNDER_WAY = 2
"""So many images are under way where they are held back: the network is never idle."""
LOST_S = 3.0
ACCOUNT_TIMEOUT_S = 60.0
READING_PERIOD_S = 1.0


class Listener:
    """Hears what the node publishes.

    Args:
        node: The ROS node that does so.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._changed = threading.Condition()
        self.began_s = time.monotonic()
        self.sent_s: dict[int, float] = {}
        """When the image of each stamp was published, and its depth has not come yet."""
        self.sent = 0
        self.latencies: list[tuple[float, float]] = []
        self.round_trips: list[tuple[float, float]] = []
        self.counts: list[Counts] = []
        """The last two."""
        handlers: dict[str, Callable[[Any], None]] = {
            DEPTH: self._on_depth,
            LATENCY: self._on_latency,
            "/diagnostics": self._on_diagnostics,
        }
        qos = QoSProfile(depth=QUEUE_DEPTH, reliability=ReliabilityPolicy.RELIABLE)
        for topic, type_name in LISTENED.items():
            node.create_subscription(message_class(type_name), topic, handlers[topic], qos, raw=topic == DEPTH)

    def unpublished(self) -> tuple[str, ...]:
        """Topics that nobody publishes yet."""
        return tuple(topic for topic in LISTENED if not self._node.count_publishers(topic))

    def start_anew(self) -> None:
        """Forgets what came so far, but for the counts."""
        self.began_s = time.monotonic()
        self.latencies.clear()
        self.round_trips.clear()

    def send(self, stamp_ns: int) -> None:
        """An image is published now."""
        self.sent_s[stamp_ns] = time.monotonic()
        self.sent += 1

    def may_send(self) -> bool:
        """Whether less images are under way than may be; waits a moment where they are not."""
        with self._changed:
            return self._changed.wait_for(lambda: self._under_way() < UNDER_WAY, 0.02)

    def await_account(self, before: Counts | None, sent: int) -> Counts:
        """Waits until the node counted all that was sent; where some was lost on the way, until nothing changes.

        Raises:
            DemoError: when that does not come about.
        """
        heard = before.heard if before else 0
        with self._changed:
            self.counts.clear()

            def is_complete() -> bool:
                return bool(
                    self.counts
                    and self.counts[-1].is_settled
                    and (self.counts[-1].heard - heard == sent or self.counts[:-1] == self.counts[1:] != [])
                )

            if not self._changed.wait_for(is_complete, ACCOUNT_TIMEOUT_S):
                raise DemoError(f"the node does not account for {sent} images; it counted {self.counts[-1:]}")
            self.sent_s.clear()
            return self.counts[-1]

    def _under_way(self) -> int:
        lost_s = time.monotonic() - LOST_S
        return sum(sent_s > lost_s for sent_s in tuple(self.sent_s.values()))

    def _on_depth(self, raw: bytes) -> None:
        now_s = time.monotonic()
        with self._changed:
            sent_s = self.sent_s.pop(header_stamp_ns(raw), None)
            if sent_s is not None:
                self.round_trips.append((now_s - self.began_s, 1e3 * (now_s - sent_s)))
            self._changed.notify_all()

    def _on_latency(self, message: Any) -> None:
        self.latencies.append((time.monotonic() - self.began_s, message.data))

    def _on_diagnostics(self, message: Any) -> None:
        statuses = {
            status.name.split(": ", 1)[1]: {value.key: value.value for value in status.values}
            for status in message.status
        }
        counts = Counts.read(statuses)
        if counts is not None:
            with self._changed:
                self.counts[:] = [*self.counts[-1:], counts]
                self._changed.notify_all()


class Soaker:
    """Plays a drive to a node.

    Args:
        plan: The drive, and how the node has to be set for it.
        process: The node.
        tell: Called again and again with the seconds under overload, and what is to be shown.
    """

    def __init__(self, plan: Plan, process: NodeProcess, tell: Callable[[float, str], None]) -> None:
        self._plan = plan
        self._process = process
        self._tell = tell
        self._readings: list[Reading] = []
        self._rounds: list[Round] = []

    def measure_rate(self) -> float:
        """Depth images a second where there is always one more to work on; half a pass to warm up, then one.

        Raises:
            DemoError: when the node gives no depth.
        """
        with self._connected(FAST) as (player, listener):

            def ready(message: PlayedMessage) -> bool:
                if message.topic != self._plan.sensors.image:
                    return True
                self._process.check()
                if not listener.may_send():
                    return False
                listener.send(header_stamp_ns(message.raw))
                return True

            counts = None
            for _ in range(2):
                listener.start_anew()
                sent = listener.sent
                with BagReader(self._plan.bag) as reader:
                    player.play(reader.messages(self._plan.played.keys()), ready)
                counts = listener.await_account(counts, listener.sent - sent)
            times_s = [at_s for at_s, _ in listener.round_trips]
        if len(times_s) < 2:
            raise DemoError(f"expected depth from the node, got none; its log ends with:\n{self._process.last_lines}")
        return (len(times_s) - 1) / (times_s[-1] - times_s[0])

    def soak(self, seconds: float, network_rate: float, image_rate: float) -> Soak:
        """Plays pass after pass.

        Args:
            seconds: So long, and then to the end of the pass.
            network_rate: From `measure_rate`.
            image_rate: Images a second to publish.

        Raises:
            DemoError: when the node ends.
        """
        with BagReader(self._plan.bag) as reader:
            rate = image_rate * reader.duration_ns / 1e9 / self._plan.images
            with self._connected(rate) as (player, listener):
                counts = listener.await_account(None, -1)
                listener.start_anew()
                while (at_s := time.monotonic() - listener.began_s) < seconds:
                    sent = listener.sent

                    def ready(message: PlayedMessage) -> bool:
                        if message.topic == self._plan.sensors.image:
                            self._read(listener)
                            listener.send(header_stamp_ns(message.raw))
                        return True

                    player.play(reader.messages(self._plan.played.keys()), ready)
                    played_s = time.monotonic() - listener.began_s - at_s
                    before, counts = counts, listener.await_account(counts, listener.sent - sent)
                    self._rounds.append(Round.between(before, counts, at_s, played_s, listener.sent - sent))
                total_s = time.monotonic() - listener.began_s
        return Soak(
            total_s,
            network_rate,
            image_rate,
            tuple(self._readings),
            tuple(listener.latencies),
            tuple(listener.round_trips),
            tuple(self._rounds),
            counts.jumps,
        )

    def _read(self, listener: Listener) -> None:
        at_s = time.monotonic() - listener.began_s
        if self._readings and at_s - self._readings[-1].at_s < READING_PERIOD_S:
            return
        self._process.check()
        self._readings.append(read_process(self._process.pid, at_s))
        self._tell(at_s, f"round {len(self._rounds) + 1}, {self._readings[-1].rss_mib:.0f} MiB")

    @contextmanager
    def _connected(self, rate: float) -> Iterator[tuple[Player, Listener]]:
        with ExitStack() as stack:
            node = stack.enter_context(ros_node())
            listener = Listener(node)
            topics = [PlayedTopic(*topic, queue_depth=QUEUE_DEPTH) for topic in self._plan.played.items()]
            player = Player(node, topics, rate)
            stack.enter_context(spinning(node))
            await_discovery(self._process, player, listener)
            yield player, listener


def soak(options: argparse.Namespace) -> Soak:
    """Simulates the drive, starts the node, measures its rate and overloads it.

    Raises:
        RadcamDepthError: when there is no drive, or the node does not do what it has to.
    """
    with tempfile.TemporaryDirectory() as temporary, progress_bar() as progress:
        folder, seconds = Path(temporary), 60 * options.minutes
        bag = options.bag or folder / "drive.mcap"
        if options.bag is None:
            task = progress.add_task("simulating a drive", total=options.frames)
            simulate(
                configuration.build(SimulationConfig, DRIVE),
                SEED,
                options.frames,
                bag,
                progress=lambda done, total: progress.update(task, completed=done, total=total),
            )
        plan = plan_drive(bag)
        depths = {f"qos_overrides.{topic}.subscription.depth": QUEUE_DEPTH for topic in plan.played}
        plan = replace(plan, parameters={**plan.parameters, **depths, **given_parameters(options.parameter)})
        plan.write_parameters(folder / "node.yaml")
        bar = progress.add_task("starting the node, measuring its rate", total=round(seconds), start=False)
        command = (sys.executable, "-c", START, "--ros-args", "--params-file", str(folder / "node.yaml"))
        with NodeProcess(folder / "node.yaml", folder / "node.log", command) as process:
            soaker = Soaker(
                plan, process, lambda at_s, text: progress.update(bar, completed=round(at_s), description=text)
            )
            network_rate = soaker.measure_rate()
            progress.start_task(bar)
            return soaker.soak(seconds, network_rate, options.overload * network_rate)


def print_figures(result: Soak, console: Console) -> None:
    """Prints what came out."""
    table = Table("", "", "target", "", title="the live node under overload", title_justify="left")
    for target in result.targets():
        table.add_row(target.name, target.value, target.limit, "held" if target.is_held else "MISSED")
    console.print(table)
    sent, pairs = sum(turn.sent for turn in result.rounds), sum(turn.pairs for turn in result.rounds)
    lost = sent - sum(turn.heard for turn in result.rounds)
    drops = [sum(turn.drops[index] for turn in result.rounds) for index in range(len(CAUSES))]
    playing_s = sum(turn.seconds for turn in result.rounds)
    console.print(
        f"{len(result.rounds)} rounds in {result.seconds:.0f} s, {100 * playing_s / result.seconds:.0f} % of them "
        f"playing; {result.jumps} backward jumps\n"
        f"images: {result.image_rate:.1f} a second, the network manages {result.network_rate:.1f}; {sent} sent, "
        f"{lost} lost on the way\n"
        f"pairs: {pairs}, {sum(turn.with_radar for turn in result.rounds)} of them with radar; "
        f"{sum(turn.out for turn in result.rounds)} depth images, dropped: "
        + ", ".join(f"{count} {cause}" for cause, count in zip(CAUSES, drops, strict=True))
    )
    for name, times in (("in the node", result.latencies), ("over DDS", result.round_trips)):
        first_ms, last_ms = result.p99_ms(times)
        console.print(f"latency p99 {name}: {first_ms:.0f} ms at first, {last_ms:.0f} ms at last")
    p99_ms = ", ".join(f"{value:.0f}" for value in result.p99_of_spans_ms(result.latencies))
    stolen = ", ".join(f"{value:.1f}" for value in result.stolen_percent())
    console.print(
        f"each {result.span_s:.0f} s: latency p99 in the node {p99_ms} ms; taken by this machine's host {stolen} % of "
        "a core"
    )
    settled_mib, end_mib = result.settled_and_end("rss_mib")
    console.print(
        f"memory: {settled_mib:.1f} MiB after {result.span_s:.0f} s, {end_mib:.1f} MiB at the end, at most "
        f"{result.most('rss_mib'):.1f} MiB in between"
    )


def _arguments(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0, help="how long the node is overloaded [30]")
    parser.add_argument("--bag", type=Path, help="play this drive; by default one is simulated")
    parser.add_argument("--frames", type=int, default=120, help="images of the simulated drive [120]")
    parser.add_argument("--overload", type=float, default=2.0, help="times as many images as the node manages [2]")
    parser.add_argument("--parameter", action="append", default=[], metavar="NAME:=VALUE", help="for the node")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Soaks, and prints a table."""
    options = _arguments(arguments)
    keep_to_this_machine()
    try:
        result = soak(options)
    except RadcamDepthError as error:
        print(f"soak: {error}", file=sys.stderr)
        return 1
    if options.json:
        write_json(result.as_json(), options.json)
    print_figures(result, Console(stderr=options.json == "-"))
    return 0 if all(target.is_held for target in result.targets()) else 1


if __name__ == "__main__":
    sys.exit(main())
