"""`radcam-depth play`: publishes a bag over DDS, without rosbag2."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING, Annotated

import typer

from radcam_depth_ros.cli.terminal.options import Bag, needs_ros, progress_bar
from radcam_depth_ros.reporting.terminal import PlainConsole

if TYPE_CHECKING:
    from radcam_depth_ros.bag_player import Progress


def play(
    bag: Bag,
    rate: Annotated[float, typer.Option(help="Seconds of the recording in one second: 0.5 is half as fast.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Begin anew at the end, until Ctrl-C.")] = False,
    start: Annotated[float, typer.Option(help="Seconds of the recording to leave out at its beginning.")] = 0.0,
    duration: Annotated[
        float | None, typer.Option(help="Seconds of the recording to play; by default to its end.")
    ] = None,
    topics: Annotated[list[str] | None, typer.Option(help="Topic to play, by default all; repeat it.")] = None,
    clock: Annotated[bool, typer.Option("--clock", help="Publish /clock, for nodes with use_sim_time.")] = False,
    delay: Annotated[
        float, typer.Option(help="Seconds before the first message, in which subscribers find the publishers.")
    ] = 1.0,
) -> None:
    """Publishes a bag's messages as they were recorded; latched messages before --start are published too.

    Each topic has the quality of service that it was recorded with. Ctrl-C stops it at once.

    Example: radcam-depth simulate out/played --seed 7 --frames 20 && radcam-depth play out/played --clock --rate 2
    """
    console = PlainConsole(stderr=True)
    # A shell has it ignored of what it starts in the background, such as by a script or a launch file.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with needs_ros("play"):
            from radcam_depth_ros import bag_player as playing
        options = playing.PlayOptions(rate, loop, start, duration, tuple(topics or ()), clock, delay)
        playback = playing.Playback(bag, options)
        for sentence in playback.left_out:
            console.print(f"left out: {sentence}", soft_wrap=True)
        console.print(f"playing {len(playback.topics)} topics, Ctrl-C ends it")
        with progress_bar() as bar:
            task = bar.add_task("seconds played", total=round(playback.total_s, 1))
            round_shown = 1

            def show(progress: Progress) -> None:
                nonlocal round_shown
                if progress.round != round_shown:
                    round_shown = progress.round
                    bar.reset(task, description=f"seconds played, round {round_shown}")
                bar.update(task, completed=progress.played_s)

            playback.run(show)
    except KeyboardInterrupt:
        console.print("interrupted")
