"""A drive through the live node: simulate (or take) a bag, play it over DDS, record the depth, measure and report."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from demo.measure import CAMERA_INFO, CONFIDENCE, DEPTH, SEMI_DENSE, Traffic, measure, write_page
from demo.plan import Plan, plan_drive
from demo.process import DemoError, NodeProcess, keep_to_this_machine
from demo.recorder import Recorder
from demo.session import Session, await_discovery, ros_node, spinning
from radcam_depth_ros.bag_player import PlayedTopic, Player
from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.encoder import OUTPUTS
from radcam_depth_ros.evaluation.tables import summary_table
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.reporting.table import Table
from radcam_depth_ros.reporting.terminal import print_table

TYPES = {f"/{output.topic}": output.type_name for output in OUTPUTS.values()}
RECORDED = {topic: TYPES[topic] for topic in (DEPTH, CAMERA_INFO, SEMI_DENSE, CONFIDENCE)}
OTHERS = {
    f"/{OUTPUTS['semi_dense_camera_info'].topic}": OUTPUTS["semi_dense_camera_info"].type_name,
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}
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
    verb = [sys.executable, "-m", "radcam_depth_ros.cli", "simulate", str(path), "--overwrite"]
    done = subprocess.run([*verb, "--seed", str(seed), "--frames", str(frames)], check=False)
    if done.returncode:
        raise DemoError(f"`radcam-depth simulate` ended with exit code {done.returncode}; its message is above")
    return path


def _run(plan: Plan, rate: float | None, recording: Path, out: Path) -> Traffic:
    """Plays the drive to a node and records what it publishes."""
    parameters = out / "node.yaml"
    plan.write_parameters(parameters)
    with contextlib.ExitStack() as stack:
        process = stack.enter_context(NodeProcess(parameters, out / "node.log"))
        node = stack.enter_context(ros_node())
        recorder = stack.enter_context(Recorder(node, RECORDED, OTHERS, recording))
        player = Player(node, [PlayedTopic(*topic) for topic in plan.played.items()], rate or 1.0)
        stack.enter_context(spinning(node))
        console.print(f"starting the node; listen along with ROS_DOMAIN_ID={os.environ['ROS_DOMAIN_ID']} ...")
        await_discovery(process, player, recorder)
        session = Session(process, recorder, plan.sensors.image, DEPTH, waits=rate is None)
        with BagReader(plan.bag) as reader, _progress(plan.images) as advance:
            session.advance = advance
            player.play(reader.messages(plan.played.keys()), session.ready, TAIL_S)
        session.finish()
        return Traffic(session.sent_s, recorder.arrivals_s(DEPTH))


@contextlib.contextmanager
def _progress(images: int) -> Iterator[Callable[[], None]]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("playing", total=images)
        yield lambda: progress.advance(task)


def _print(table: Table) -> None:
    print_table(Console(), table.title, table.columns, table.rows, table.note)


def main() -> None:
    """Runs the demo on this machine only, in a domain of its own unless one is chosen."""
    keep_to_this_machine()
    typer.run(demo)


if __name__ == "__main__":
    main()
