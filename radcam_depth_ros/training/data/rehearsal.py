"""Simulated drives that are trained on besides new ones, so that a network does not forget what it knew."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from radcam_depth_ros import configuration
from radcam_depth_ros.extras import install_extra
from radcam_depth_ros.training.errors import TrainingError

_FIRST_TEST_SEED = 1_000_000


@dataclass(frozen=True)
class RehearsalConfig:
    """What of a network's former training is repeated.

    Attributes:
        share: Of all samples that are rehearsals; 0 for none.
        tolerance: By how much the error on rehearsed drives may rise: weights that have forgotten more are not kept.
        frames: Simulated frames to rehearse, where no bags of them are given.
        frames_per_drive: Frames of one street.
        first_seed: Seed of the first drive; each has the next.
        hold_out: Share of the drives that are not trained on but validated on.
        simulation: What differs from the simulator's defaults.
    """

    share: float
    tolerance: float
    frames: int
    frames_per_drive: int
    first_seed: int
    hold_out: float
    simulation: Mapping[str, Any]

    def __post_init__(self) -> None:
        if not 0 <= self.share < 1 or not 0 < self.hold_out < 1 or self.tolerance < 0:
            raise TrainingError(
                "rehearsal needs a share of at least 0 and below 1, hold_out between 0 and 1 and a tolerance of at "
                f"least 0, got {self.share}, {self.hold_out} and {self.tolerance}"
            )
        if self.frames_per_drive < 1 or self.frames < 2 * self.frames_per_drive:
            raise TrainingError(
                "rehearsal needs frames for two drives, one of them to validate on, got frames of "
                f"{self.frames} and frames_per_drive of {self.frames_per_drive}"
            )
        if not 0 <= self.first_seed <= _FIRST_TEST_SEED - self.drives:
            raise TrainingError(
                f"rehearsal.first_seed must be 0 to {_FIRST_TEST_SEED - self.drives}, got {self.first_seed}; seeds "
                f"from {_FIRST_TEST_SEED} on are kept for measuring"
            )

    @property
    def drives(self) -> int:
        """Number of drives."""
        return -(-self.frames // self.frames_per_drive)


def rehearsal_drives(
    config: RehearsalConfig, folder: Path, processes: int = 1, on_drive: Callable[[], None] = lambda: None
) -> tuple[Path, ...]:
    """Bags to rehearse; those that are not in `folder` yet are simulated.

    Args:
        config: What to simulate.
        folder: Where simulated drives are kept; those of another simulation have another place in it.
        processes: Drives that are simulated at once.
        on_drive: Called after each drive that is ready.

    Raises:
        TrainingError: when the simulator is not installed.
        SimulationError: for settings that it refuses.
        BagError: when a bag cannot be written.
    """
    mapping = _simulation(config)
    key = json.dumps([mapping, config.frames_per_drive], sort_keys=True)
    place = folder / f"simulated-{hashlib.sha256(key.encode()).hexdigest()[:12]}"
    seeds = range(config.first_seed, config.first_seed + config.drives)
    bags = {seed: place / f"seed_{seed}.mcap" for seed in seeds}
    missing = [seed for seed in seeds if not bags[seed].is_file()]
    for _ in range(len(bags) - len(missing)):
        on_drive()
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TrainingError(
            f"cannot make {place}: {error.strerror or error}; choose another place with --cache"
        ) from None
    if processes == 1:
        for seed in missing:
            _simulate(mapping, seed, config.frames_per_drive, bags[seed])
            on_drive()
    elif missing:
        # spawn: a forked child of a process that has used torch's threads may hang.
        with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
            futures = [pool.submit(_simulate, mapping, seed, config.frames_per_drive, bags[seed]) for seed in missing]
            try:
                for future in as_completed(futures):
                    future.result()
                    on_drive()
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
    return tuple(bags.values())


def _simulation(config: RehearsalConfig) -> dict[str, Any]:
    """All settings of the simulation, checked; TrainingError when there is no simulator."""
    try:
        from radcam_depth_ros import simulation  # here, so that training without rehearsal runs without the extra `sim`
    except ModuleNotFoundError as error:
        raise TrainingError(
            f"rehearsal simulates drives, for which the package {error.name} is missing; give --rehearsal-bags, set "
            f"rehearsal.share to 0, or {install_extra('train')}"
        ) from error
    settings = configuration.build(simulation.SimulationConfig, config.simulation, "rehearsal.simulation")
    return configuration.as_mapping(settings)


def _simulate(mapping: Mapping[str, Any], seed: int, frames: int, out: Path) -> None:
    import cv2

    from radcam_depth_ros import simulation

    # As many processes as there are cores: threads of each would only get in each other's way.
    cv2.setNumThreads(1)
    simulation.simulate(configuration.build(simulation.SimulationConfig, mapping), seed, frames, out)
