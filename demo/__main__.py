"""A drive through the live node: simulate (or take) a bag, play it over DDS, record the depth, measure and report."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import rclpy
import typer
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table as RichTable

from demo.measure import CAMERA_INFO, CONFIDENCE, DEPTH, SEMI_DENSE, Traffic, measure, write_page
from demo.plan import NODE_NAME, Plan, plan_drive
from demo.player import CLOCK_PERIOD_S, PlayedMessage, Player
from demo.process import DemoError, NodeProcess
from demo.recorder import Recorder, header_stamp_ns
from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.evaluation.tables import Table, summary_table
from radcam_depth_ros.frame import RadcamDepthError

IMAGE = "sensor_msgs/msg/Image"
OUTPUTS = {DEPTH: IMAGE, CAMERA_INFO: "sensor_msgs/msg/CameraInfo", SEMI_DENSE: IMAGE, CONFIDENCE: IMAGE}
OTHERS = {
    "/semi_dense/camera_info": "sensor_msgs/msg/CameraInfo",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}
START_TIMEOUT_S = 180.0
FRAME_TIMEOUT_S = 30.0
TAIL_S = 1.0
console = Console(stderr=True)


def demo(
    bag: Annotated[Path | None, typer.Option(help="Play this drive; by default one is simulated.")] = None,
    rate: Annotated[
        float | None, typer.Option(min=0.01, help="Play at this rate, 1 is real time; by default as fast as the node.")
    ] = None,
    frames: Annotated[int, typer.Option(min=2, help="Frames to simulate, 10 a second.")] = 50,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated drive.")] = 1_000_001,
    model: Annotated[Path | None, typer.Option(help="Weight file, in place of the package's own.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for the recording and the report.")] = Path("out/demo"),
) -> None:
    """Plays a drive through the live node and reports what came out.

    Example: python -m demo --frames 20
    """
    try:
        _demo(bag or _simulate(out / "drive.mcap", frames, seed), model, rate, out)
    except RadcamDepthError as error:
        print(f"demo: {error}", file=sys.stderr)
        raise typer.Exit(1) from None


def _demo(bag: Path, model: Path | None, rate: float | None, out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    plan = plan_drive(bag, model)
    recording, report = out / "depth.mcap", out / "report.html"
    traffic = _run(plan, rate, recording, out)
    console.print("measuring ...")
    evaluation, keeper = measure(plan, recording)
    write_page(report, plan, traffic, evaluation, keeper)
    for table in (traffic.table(), *([summary_table(evaluation)] if evaluation.has_ground_truth else [])):
        _print(table)
    print(f"recorded: {recording}\nreport:   {report}")
    if rate is None and traffic.dropped:
        raise DemoError(
            f"{traffic.dropped} of {len(traffic.sent_s)} images got no depth image; see {out / 'node.log'} for why"
        )


def _simulate(path: Path, frames: int, seed: int) -> Path:
    console.print(f"simulating a drive of {frames} frames, seed {seed} ...")
    path.unlink(missing_ok=True)
    verb = [sys.executable, "-m", "radcam_depth_ros.cli", "simulate", str(path)]
    done = subprocess.run([*verb, "--seed", str(seed), "--frames", str(frames)], check=False)
    if done.returncode:
        raise DemoError(f"`radcam-depth simulate` ended with exit code {done.returncode}; its message is above")
    return path


def _run(plan: Plan, rate: float | None, recording: Path, out: Path) -> Traffic:
    """Plays the drive to a node and records what it publishes."""
    parameters = out / "node.yaml"
    plan.write_parameters(parameters)
    with contextlib.ExitStack() as stack:
        process = stack.enter_context(NodeProcess(parameters, out / "node.log", plan.remappings))
        node = stack.enter_context(_ros_node())
        recorder = stack.enter_context(Recorder(node, OUTPUTS, OTHERS, recording))
        player = Player(node, plan.played, rate or 1.0)
        stack.enter_context(_spinning(node))
        console.print(f"starting the node; listen along with ROS_DOMAIN_ID={os.environ['ROS_DOMAIN_ID']} ...")
        _await_discovery(process, player, recorder)
        session = _Session(process, recorder, plan.sensors.image, waits=rate is None)
        with BagReader(plan.bag) as reader, _progress(plan.images) as advance:
            session.advance = advance
            player.play(reader.messages(plan.played.keys()), session.ready, TAIL_S)
        session.finish()
        return Traffic(session.sent_s, recorder.arrivals_s(DEPTH))


class _Session:
    """Decides when the next message may be played, and notes when each image was.

    Args:
        process: The node.
        recorder: Of what it publishes.
        image_topic: The images among what is played.
        waits: Hold the recording back until the depth of the last image is there.
    """

    def __init__(self, process: NodeProcess, recorder: Recorder, image_topic: str, waits: bool) -> None:
        self._process = process
        self._recorder = recorder
        self._image_topic = image_topic
        self._waits = waits
        self._last_ns: int | None = None
        self._missed_in_a_row = 0
        self.sent_s: dict[int, float] = {}
        self.advance: Callable[[], None] = lambda: None

    def ready(self, message: PlayedMessage) -> bool:
        """Whether a message may be played now."""
        if message.topic != self._image_topic:
            return True
        self._process.check()
        if self._waits and self._last_ns is not None and not self._is_over(self._last_ns):
            return False
        self._last_ns = header_stamp_ns(message.raw)
        self.sent_s[self._last_ns] = time.monotonic()
        self.advance()
        return True

    def finish(self) -> None:
        """Waits for the last depth image."""
        while self._last_ns is not None and not self._is_over(self._last_ns):
            self._process.check()
        if not self._recorder.arrivals_s(DEPTH):
            raise DemoError(f"the node gave no depth image at all; its log ends with:\n{self._process.last_lines}")

    def _is_over(self, stamp_ns: int) -> bool:
        """Whether the depth of an image came, or is not to be waited for any longer."""
        if self._recorder.wait_for(stamp_ns, CLOCK_PERIOD_S):
            self._missed_in_a_row = 0
            return True
        if time.monotonic() - self.sent_s[stamp_ns] < FRAME_TIMEOUT_S:
            return False
        self._missed_in_a_row += 1
        if self._missed_in_a_row == 3:
            raise DemoError(
                f"no depth image came for 3 images in a row within {FRAME_TIMEOUT_S:.0f} s each; the node's log ends "
                f"with:\n{self._process.last_lines}"
            )
        return True


def _await_discovery(process: NodeProcess, player: Player, recorder: Recorder) -> None:
    """Waits until the node listens to all that is played, and publishes all that is recorded."""
    deadline_s = time.monotonic() + START_TIMEOUT_S
    while missing := (*player.unheard(), *recorder.unpublished()):
        process.check()
        if problem := process.problem:
            raise DemoError(f"the node cannot start: {problem}")
        if time.monotonic() > deadline_s:
            raise DemoError(
                f"after {START_TIMEOUT_S:.0f} s the node still lacks {', '.join(missing)}; its log ends with:\n"
                f"{process.last_lines}"
            )
        time.sleep(0.05)


@contextlib.contextmanager
def _ros_node() -> Iterator[Node]:
    rclpy.init(args=[])
    node = rclpy.create_node(f"{NODE_NAME}_demo")
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


@contextlib.contextmanager
def _spinning(node: Node) -> Iterator[None]:
    """Takes a node's messages in a thread of its own."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def spin() -> None:
        with contextlib.suppress(ExternalShutdownException):
            executor.spin()

    thread = threading.Thread(target=spin, name="recording", daemon=True)
    thread.start()
    try:
        yield
    finally:
        executor.shutdown()
        thread.join()


@contextlib.contextmanager
def _progress(images: int) -> Iterator[Callable[[], None]]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("playing", total=images)
        yield lambda: progress.advance(task)


def _print(table: Table) -> None:
    rich_table = RichTable(title=table.title, caption=table.note or None, title_justify="left", caption_justify="left")
    for index, column in enumerate(table.columns):
        rich_table.add_column(column, justify="right" if index else "left")
    for row in table.rows:
        rich_table.add_row(*row)
    Console().print(rich_table)


def main() -> None:
    """Runs the demo on this machine only, in a domain of its own unless one is chosen."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(10 + os.getpid() % 50))
    # The default shared-memory segments are smaller than one image.
    profile = Path(__file__).parents[1] / "config" / "fastdds.xml"
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(profile))
    typer.run(demo)


if __name__ == "__main__":
    main()
