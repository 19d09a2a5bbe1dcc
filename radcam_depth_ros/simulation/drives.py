"""Simulates many drives, several at once."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import cv2

from radcam_depth_ros.simulation.recording import simulate
from radcam_depth_ros.simulation.settings.configuration import SimulationConfig
from radcam_depth_ros.simulation.settings.errors import SimulationError


def simulate_drives(
    config: SimulationConfig,
    seeds: Sequence[int],
    frames: int,
    folder: Path,
    jobs: int,
    *,
    overwrite: bool = False,
    progress: Callable[[int], None] = lambda seed: None,
) -> None:
    """Writes a bag `folder`/SEED for each seed; one that is there already is kept, so that this goes on where it ended.

    Args:
        config: What to simulate.
        seeds: Of the drives, see `simulate`.
        frames: Number of images of each.
        folder: Where the bags are written.
        jobs: Processes that work at once, each on one thread, at least 1.
        overwrite: Make drives anew that are there.
        progress: Called with a seed when its drive is there.

    Raises:
        SimulationError: for no seed, no process, or one that is killed; drives that are written stay.
        BagError: when a bag cannot be written.
    """
    if not seeds or jobs < 1:
        raise SimulationError(f"expected at least 1 drive and 1 process, got {len(seeds)} and {jobs}")
    todo = []
    for seed in seeds:
        if (folder / str(seed)).exists() and not overwrite:
            progress(seed)
        else:
            todo.append(seed)
    folder.mkdir(parents=True, exist_ok=True)
    # spawn: a forked child of a process that has used threads may hang.
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), initializer=_alone) as pool:
        waiting: dict[Future[None], int] = {
            pool.submit(simulate, config, seed, frames, folder / str(seed), overwrite=overwrite): seed for seed in todo
        }
        try:
            while waiting:
                done, _ = wait(waiting, return_when=FIRST_COMPLETED)
                for future in done:
                    seed = waiting.pop(future)
                    future.result()
                    progress(seed)
        except BrokenProcessPool:
            raise SimulationError(
                "a process that simulated a drive was killed, most likely since memory ran out; simulate fewer at once "
                f"(--jobs, now {jobs}), what is written is kept"
            ) from None
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _alone() -> None:
    """OpenCV takes one thread in each process: with as many processes as cores more would wait for each other."""
    cv2.setNumThreads(1)
