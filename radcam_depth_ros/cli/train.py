"""`radcam-depth train`: fit a network on bags."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer
import yaml
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from radcam_depth_ros.training.fit import FitResult, StepReport, TrainingData
    from radcam_depth_ros.training.recipe import TrainingConfig
    from radcam_depth_ros.training.validation import ValidationResult

STOPPED = 130
"""Exit code of a run that was stopped by a signal, as shells have it for Ctrl-C."""


def train(
    out: Annotated[Path, typer.Option(help="Folder of the run: weights, checkpoint, metrics, curves.")],
    more_bags: Annotated[list[Path] | None, typer.Argument(metavar="[BAG]...", help="More --bags.")] = None,
    network: Annotated[str, typer.Option(help="Name of the network.")] = "baff",
    bags: Annotated[list[Path] | None, typer.Option(help="Bags to train on, or folders that hold some.")] = None,
    validation_bags: Annotated[
        list[Path] | None, typer.Option(help="Bags to choose the best weights by; else some of --bags are held out.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="Recipe; its defaults are those of config/train/baff.yaml.")
    ] = None,
    init: Annotated[
        str | None, typer.Option(help="Weights to start from: a network's name, or a file; else they are random.")
    ] = None,
    minutes: Annotated[
        float | None, typer.Option(min=0.01, help="Time limit; the schedule is fitted to it. Resuming counts on.")
    ] = None,
    iterations: Annotated[int | None, typer.Option(min=1, help="Length, in place of the recipe's.")] = None,
    seed: Annotated[
        int | None, typer.Option(help="Of weights, order and augmentation, in place of the recipe's.")
    ] = None,
    cache: Annotated[
        Path | None, typer.Option(help="Where prepared samples are kept; by default in the run's folder.")
    ] = None,
    ground_truth: Annotated[
        str,
        typer.Option(
            help="any: exact depth images where a bag has them, else LiDAR, accumulated where it has odometry; exact; "
            "lidar; both: exact, and the nearest LiDAR scan besides."
        ),
    ] = "any",
    processes: Annotated[int, typer.Option(min=1, help="Bags that are prepared at once.")] = 2,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the run in --out, with its bags and recipe.")
    ] = False,
) -> None:
    """Fits a network on bags that have ground truth: simulated drives, or recordings with a LiDAR.

    Ctrl-C stops with a checkpoint; --resume goes on from there as if nothing had happened.

    Example: radcam-depth simulate out/drives/0 --seed 0 --frames 20 &&
    radcam-depth train --bags out/drives --out out/run --minutes 1
    """
    from radcam_depth_ros import configuration
    from radcam_depth_ros.files import write_text
    from radcam_depth_ros.training.fit import RUN_FILE, Limits, Trainer
    from radcam_depth_ros.training.recipe import TrainingConfig
    from radcam_depth_ros.training.samples import TrainingError

    console = Console(stderr=True)
    given = [*(bags or []), *(more_bags or [])]
    if resume:
        if given or validation_bags or config or init or seed is not None:
            raise TrainingError(
                "--resume takes bags, recipe, weights and seed from the run's folder; leave --bags, --validation-bags, "
                "--config, --init and --seed out"
            )
        plan = _read_plan(out)
    else:
        plan = _new_plan(out, network, given, validation_bags or [], config, cache, seed, init)
        plan["ground_truth"] = ground_truth
    if iterations is not None:
        plan["config"]["iterations"] = iterations
    if minutes is not None:
        plan["minutes"] = minutes
    recipe = configuration.build(TrainingConfig, plan["config"], str(out / RUN_FILE))
    with _progress(console) as progress:
        data = _load(plan, recipe, processes, progress)
        write_text(out / RUN_FILE, yaml.safe_dump(plan, sort_keys=False))
        console.print(f"training {plan['network']} on {data.description}; validating on {len(data.validation)}")
        with _stop_signals() as stop:
            observer = _Display(progress)
            trainer = Trainer(plan["network"], data, recipe, out, observer, resume, init)
            result = trainer.run(Limits(plan["minutes"], stop.is_set))
    _finish(result, out, console)


class _Display:
    """Shows a run as a progress bar, and a line for each validation."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._task: TaskID = progress.add_task("training", total=1.0, status="")

    def on_step(self, report: StepReport) -> None:
        best = f", best {report.best_score:.2f} m" if report.best_score < float("inf") else ""
        status = f"{report.step} it, {report.iterations_per_second:.2f} it/s, loss {report.loss:.3f}{best}"
        self._progress.update(self._task, completed=report.progress, status=status)

    def on_validation(self, step: int, result: ValidationResult, is_best: bool) -> None:
        self._progress.console.print(
            f"{step:7d} it: dense MAE {result.mae_50_m:.2f} / {result.mae_80_m:.2f} m, RMSE {result.rmse_50_m:.2f} / "
            f"{result.rmse_80_m:.2f} m (50 / 80 m); semi-dense {100 * result.semi_dense_share:.1f} %, "
            f"MAE {result.semi_dense_mae_m:.2f} m{' *' if is_best else ''}"
        )


def _new_plan(
    out: Path,
    network: str,
    bags: list[Path],
    validation_bags: list[Path],
    config: Path | None,
    cache: Path | None,
    seed: int | None,
    init: str | None,
) -> dict[str, Any]:
    """What a run is made of, as its run.yaml has it."""
    from radcam_depth_ros import configuration
    from radcam_depth_ros.networks import archive, registry
    from radcam_depth_ros.training.data import find_bags
    from radcam_depth_ros.training.fit import RUN_FILE
    from radcam_depth_ros.training.recipe import TrainingConfig
    from radcam_depth_ros.training.samples import TrainingError

    if not bags:
        raise TrainingError("give the bags to train on: --bags FOLDER")
    if (out / RUN_FILE).exists():
        raise TrainingError(f"{out} already holds a run; give --resume to go on with it, or another --out")
    recipe = configuration.load(TrainingConfig, config) if config else TrainingConfig()
    mapping = configuration.as_mapping(recipe)
    if seed is not None:
        mapping["seed"] = seed
    if init is not None:
        # The architecture of the weights, tau among it, but for what the recipe says.
        mapping["architecture"] = {**archive.load(init).card.architecture, **mapping["architecture"]}
    registry.create_config(network, mapping["architecture"])
    return {
        "network": network,
        "bags": [str(bag.resolve()) for bag in find_bags(bags)],
        "validation_bags": [str(bag.resolve()) for bag in find_bags(validation_bags)],
        "cache": str((cache or out / "cache").resolve()),
        "minutes": None,
        "config": mapping,
    }


def _read_plan(out: Path) -> dict[str, Any]:
    from radcam_depth_ros.training.fit import RUN_FILE
    from radcam_depth_ros.training.samples import TrainingError

    path = out / RUN_FILE
    try:
        plan = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, yaml.YAMLError):
        raise TrainingError(f"{out} holds no run to resume: {path} is missing or damaged") from None
    keys = {"network", "bags", "validation_bags", "cache", "minutes", "config", "ground_truth"}
    if not isinstance(plan, dict) or set(plan) != keys:
        raise TrainingError(f"{path} must hold {', '.join(sorted(keys))}; it was changed by hand, start another run")
    return plan


def _load(plan: dict[str, Any], recipe: TrainingConfig, processes: int, progress: Progress) -> TrainingData:
    from radcam_depth_ros.drive import DriveSettings
    from radcam_depth_ros.networks import registry
    from radcam_depth_ros.training.cache import CacheSettings
    from radcam_depth_ros.training.data import load_data

    architecture = registry.create_config(plan["network"], recipe.architecture)
    drive = DriveSettings(ground_truth=plan["ground_truth"], accumulate="where_possible")
    settings = CacheSettings(architecture.focal_length_px, architecture.max_depth_m, drive)
    bags = [Path(bag) for bag in plan["bags"]]
    validation_bags = [Path(bag) for bag in plan["validation_bags"]]
    task = progress.add_task("samples", total=len(bags) + len(validation_bags), status="")

    def on_bag(bag: Path) -> None:
        progress.update(task, advance=1, status=bag.name)

    cache, hold_out = Path(plan["cache"]), recipe.validation.hold_out
    return load_data(
        bags, validation_bags, hold_out, cache, settings, processes, on_bag, lambda note: progress.console.print(note)
    )


def _finish(result: FitResult, out: Path, console: Console) -> None:
    if not result.finished:
        console.print(f"stopped at iteration {result.state.step}; go on with: radcam-depth train --out {out} --resume")
        raise typer.Exit(STOPPED)
    console.print(f"{result.archive}: validation MAE at 80 m {result.state.best_score:.3f} m")


def _progress(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TextColumn("{task.fields[status]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
    )


@contextmanager
def _stop_signals() -> Iterator[Event]:
    """SIGINT and SIGTERM set the event; what they did before is restored at the end."""
    stop = Event()

    def on_signal(number: int, frame: FrameType | None) -> None:
        # A second Ctrl-C is for those who cannot wait.
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    before = {number: signal.signal(number, on_signal) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
