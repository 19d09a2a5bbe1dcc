"""`radcam-depth train`: fits a network on bags."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from radcam_depth_ros.cli.terminal.fleet_runs import OnOption, ShardOption, finish, found_bags, run_fleet
from radcam_depth_ros.cli.terminal.node_parameters import INFERENCE, OUTPUT, ParamsOption, node_parameters
from radcam_depth_ros.cli.terminal.options import (
    BackboneOption,
    CacheOption,
    GroundTruthOption,
    InitOption,
    MinutesOption,
    RecipeOption,
    RehearsalBagsOption,
    SeedOption,
    TeacherOption,
    TensorboardOption,
    ValidationBagsOption,
    keep_apart,
)
from radcam_depth_ros.reporting.terminal import PlainConsole

if TYPE_CHECKING:
    from radcam_depth_ros.training.distributed.ranks import Ranks
    from radcam_depth_ros.training.drives import OnTask
    from radcam_depth_ros.training.fit import FitResult
    from radcam_depth_ros.training.initial import Sources
    from radcam_depth_ros.training.observer import StepReport, ValidationReport
    from radcam_depth_ros.training.plan import RunPlan
    from radcam_depth_ros.training.validation import ValidationResult

STOPPED = 130
"""Exit code of a run that was stopped by a signal, as shells have it for Ctrl-C."""


def train(
    out: Annotated[Path, typer.Option(help="Folder of the run: weights, checkpoint, metrics, curves.")],
    more_bags: Annotated[list[Path] | None, typer.Argument(metavar="[BAG]...", help="More --bags.")] = None,
    params: ParamsOption = None,
    network: Annotated[str | None, typer.Option(help="Name of the network.", show_default="baff")] = None,
    bags: Annotated[list[Path] | None, typer.Option(help="Bags to train on, or folders that hold some.")] = None,
    validation_bags: ValidationBagsOption = None,
    config: RecipeOption = None,
    init: InitOption = None,
    backbone_weights: BackboneOption = None,
    teacher: TeacherOption = None,
    rehearsal_bags: RehearsalBagsOption = None,
    minutes: MinutesOption = None,
    iterations: Annotated[int | None, typer.Option(min=1, help="Length, in place of the recipe's.")] = None,
    seed: SeedOption = None,
    cache: CacheOption = None,
    tensorboard: TensorboardOption = False,
    ground_truth: GroundTruthOption = "any",
    processes: Annotated[int, typer.Option(min=1, help="Bags that are prepared at once.")] = 2,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the run in --out, with its bags and recipe.")
    ] = False,
    growing: Annotated[
        bool, typer.Option("--growing", help="Take bags, too, that come into the places of --bags while it trains.")
    ] = False,
    cache_only: Annotated[
        bool, typer.Option("--cache-only", help="Prepare the samples of all bags that are given, and train nothing.")
    ] = False,
    shard: ShardOption = None,
    on: OnOption = None,
) -> None:
    """Fits a network on bags that have ground truth: simulated drives, or recordings with a LiDAR.

    Ctrl-C stops with a checkpoint; --resume goes on from there as if nothing had happened. Several processes share the
    work when torchrun starts them.

    Example: radcam-depth simulate out/drives/0 --seed 0 --frames 20 &&
    radcam-depth train --bags out/drives --out out/run --minutes 1
    """
    from radcam_depth_ros.training.distributed.ranks import joined
    from radcam_depth_ros.training.initial import Sources

    _require_cache_only(cache_only, shard or on)
    with joined() as ranks:
        console = PlainConsole(stderr=True, quiet=not ranks.is_first)
        asked = _Request(
            out=out,
            network=network,
            bags=(*(bags or ()), *(more_bags or ())),
            validation_bags=tuple(validation_bags or ()),
            rehearsal_bags=tuple(rehearsal_bags or ()),
            params=params,
            recipe=config,
            cache=cache,
            sources=Sources(init, backbone_weights, teacher),
            ground_truth=ground_truth,
            seed=seed,
            is_growing=growing,
        )
        plan = _resumed_plan(asked) if resume else _new_plan(asked)
        if cache_only:
            _cache(plan, shard, on)
            return
        recipe = replace(
            plan.config,
            iterations=iterations or plan.config.iterations,
            minutes=minutes or plan.config.minutes,
            seed=plan.config.seed if seed is None else seed,
            tensorboard=tensorboard or plan.config.tensorboard,
        )
        result = _run(replace(plan, config=recipe), out, processes, ranks, console, resume=resume)
        _finish(result, out, console)


@dataclass(frozen=True)
class _Request:
    """The options that a resumed run takes from its folder instead; None and empty for those not given.

    Attributes:
        out: Folder of the run.
        network: Name of the network.
        bags: Bags to train on, or folders of bags.
        validation_bags: Bags to choose the best weights by.
        rehearsal_bags: Bags to rehearse.
        params: The node's parameter file.
        recipe: The recipe's file.
        cache: Folder of prepared samples.
        sources: Weights to start or learn from.
        ground_truth: Which ground truth of the bags is taken.
        seed: Of weights, order and augmentation.
        is_growing: Whether bags that come while it trains are taken.
    """

    out: Path
    network: str | None
    bags: tuple[Path, ...]
    validation_bags: tuple[Path, ...]
    rehearsal_bags: tuple[Path, ...]
    params: Path | None
    recipe: Path | None
    cache: Path | None
    sources: Sources
    ground_truth: str
    seed: int | None
    is_growing: bool


def _run(plan: RunPlan, out: Path, processes: int, ranks: Ranks, console: Console, *, resume: bool) -> FitResult:
    """Trains as planned, until done or a signal."""
    from radcam_depth_ros.training.checkpoint import before
    from radcam_depth_ros.training.curves import require_tensorboard
    from radcam_depth_ros.training.drives import growth_of, load
    from radcam_depth_ros.training.fit import CHECKPOINT, Trainer

    if plan.config.tensorboard:
        require_tensorboard()
    # The chosen precision is kept with the run: resumed on another machine, it computes as before.
    plan = ranks.of_first(replace(plan, config=plan.config.with_chosen_precision()))
    with _progress(console) as progress:
        note = progress.console.print
        with ranks.first_goes_ahead():
            data = load(plan, out, processes, _tasks(progress), note)
        if ranks.is_first:
            plan.write(out)
        console.print(f"training {plan.network} on {data.description}; validating on {len(data.validation)}")
        with _stop_signals() as stop:
            # A run that was cut off before its first checkpoint begins again.
            has_checkpoint = (out / CHECKPOINT).is_file() or before(out / CHECKPOINT).is_file()
            goes_on, observer = resume and has_checkpoint, _Display(progress)
            growth = growth_of(plan, out, processes, lambda: _found(plan.growing), note)
            trainer = Trainer(plan.network, data, plan.config, out, observer, goes_on, plan.sources, ranks, growth)
            with growth if growth is not None and ranks.is_first else nullcontext():
                return trainer.run(stop.is_set)


def _found(places: Sequence[str]) -> tuple[str, ...]:
    return tuple(_found_again(bag) for bag in found_bags([Path(place) for place in places]))


def _resumed_plan(asked: _Request) -> RunPlan:
    """The plan in the run's folder; TrainingError for options that it decides."""
    from radcam_depth_ros.training.errors import TrainingError
    from radcam_depth_ros.training.initial import Sources
    from radcam_depth_ros.training.plan import RunPlan

    decided = (asked.bags, asked.params, asked.validation_bags, asked.rehearsal_bags, asked.recipe)
    if any(decided) or asked.sources != Sources() or asked.seed is not None or asked.is_growing:
        raise TrainingError(
            "--resume takes bags, recipe, weights and seed from the run's folder; leave --bags, --validation-bags, "
            "--rehearsal-bags, --params, --config, --init, --backbone-weights, --teacher, --seed and --growing out"
        )
    plan = RunPlan.read(asked.out)
    if not plan.growing:
        return plan
    others = {*plan.validation_bags, *plan.rehearsal_bags}
    return replace(plan, bags=tuple(bag for bag in _found(plan.growing) if bag not in others))


class _Display:
    """Shows a run as a progress bar, and a line for each validation."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._task: TaskID = progress.add_task("training", total=1.0, status="")

    def on_step(self, report: StepReport) -> None:
        best = f", best {report.best_score:.2f} m" if report.best_score < float("inf") else ""
        status = f"{report.step} it, {report.iterations_per_second:.2f} it/s, loss {report.loss:.3f}{best}"
        self._progress.update(self._task, completed=report.progress, status=status)

    def on_validation(self, report: ValidationReport) -> None:
        parts = [_figures(report.result)]
        if report.rehearsal is not None:
            parts.append(f"rehearsed: {_figures(report.rehearsal)}")
        self.on_note(f"{report.step:7d} it: {'; '.join(parts)}{' *' if report.is_best else ''}")

    def on_note(self, text: str) -> None:
        self._progress.console.print(text)


def _figures(result: ValidationResult) -> str:
    return (
        f"dense MAE {result.mae_50_m:.2f} / {result.mae_80_m:.2f} m, RMSE {result.rmse_50_m:.2f} / "
        f"{result.rmse_80_m:.2f} m (50 / 80 m), semi-dense {100 * result.semi_dense_share:.1f} %, MAE "
        f"{result.semi_dense_mae_m:.2f} m"
    )


def _new_plan(asked: _Request) -> RunPlan:
    from radcam_depth_ros import configuration
    from radcam_depth_ros.networks import registry
    from radcam_depth_ros.networks.weights_io import archive
    from radcam_depth_ros.storage import place_of
    from radcam_depth_ros.training.errors import TrainingError
    from radcam_depth_ros.training.losses.registry import Criterion
    from radcam_depth_ros.training.plan import RUN_FILE, RunPlan
    from radcam_depth_ros.training.recipe import FINE_TUNING, load, recipe_of

    out, sources = asked.out, asked.sources
    node = node_parameters(asked.params, {"network": asked.network}, unused=(*OUTPUT, *INFERENCE))
    network, read = node.config.estimator.network, node.drive_settings(ground_truth=asked.ground_truth)
    if not asked.bags:
        raise TrainingError("give the bags to train on: --bags FOLDER")
    if (out / RUN_FILE).exists():
        raise TrainingError(f"{out} already holds a run; give --resume to go on with it, or another --out")
    keep_apart(
        (out / RUN_FILE, out / f"{network}.safetensors"),
        (*asked.bags, *asked.validation_bags, *asked.rehearsal_bags, asked.params, asked.recipe, *sources.files),
    )
    name = network if sources.initial is None else FINE_TUNING
    recipe = recipe_of(name) if asked.recipe is None else load(asked.recipe)
    if sources.initial is not None:
        # The architecture of the weights, tau among it, but for what the recipe says.
        given = archive.load(sources.initial).card.architecture
        recipe = replace(recipe, architecture={**given, **recipe.architecture})
    registry.create_config(network, recipe.architecture)
    # All of them, so that a run is the same whatever the defaults become.
    recipe = replace(recipe, loss=configuration.as_mapping(Criterion.of(network, recipe.loss).config))
    if asked.rehearsal_bags and not recipe.rehearsal.share:
        raise TrainingError("--rehearsal-bags need a share in the recipe: set rehearsal.share, 0.5 for example")
    if asked.is_growing and not asked.validation_bags:
        raise TrainingError("--growing needs bags that are always held out: give them by --validation-bags")
    found, held_out, rehearsed = (
        _found([place_of(place) for place in places])
        for places in (asked.bags, asked.validation_bags, asked.rehearsal_bags)
    )
    return RunPlan(
        network,
        recipe,
        found,
        held_out,
        rehearsed,
        _found_again(place_of(asked.cache or out / "cache")),
        # Absolute paths, which are valid wherever a run is resumed from.
        replace(sources, initial=_source(sources.initial), teacher=_source(sources.teacher)),
        read.ground_truth,
        read.frame_builder,
        read.topics,
        tuple(_found_again(place_of(bag)) for bag in asked.bags) if asked.is_growing else (),
    )


def _source(source: str | None) -> str | None:
    """A network's name as it is, a file by its whole path."""
    from radcam_depth_ros.networks import registry

    return source if source is None or source in registry.names() else _found_again(source)


def _found_again(place: str) -> str:
    """A URL as it is, a file or folder by its whole path."""
    from radcam_depth_ros.storage import is_remote

    return place if is_remote(place) else str(Path(place).resolve())


def _require_cache_only(cache_only: bool, shared: str | None) -> None:
    from radcam_depth_ros.training.errors import TrainingError

    if shared and not cache_only:
        raise TrainingError("--shard and --on share the work of --cache-only alone; a training is shared by torchrun")


def _cache(plan: RunPlan, shard: str | None, on: str | None) -> None:
    """Prepares the samples of the bags of a shard. Which of them are held out does not matter for that."""
    from radcam_depth_ros.fleet.work.caching import Caching
    from radcam_depth_ros.training.drives import cache_settings

    bags = sorted({*plan.bags, *plan.validation_bags})
    finish(run_fleet(Caching(plan.cache, cache_settings(plan)), bags, Path(plan.cache), shard, on))


def _tasks(progress: Progress) -> OnTask:
    """Shows each task as a bar."""

    def on_task(name: str, total: int) -> Callable[[str], None]:
        task = progress.add_task(name, total=total, status="")
        return lambda status: progress.update(task, advance=1, status=status)

    return on_task


def _finish(result: FitResult, out: Path, console: Console) -> None:
    if not result.finished:
        console.print(f"stopped at iteration {result.state.step}; go on with: radcam-depth train --out {out} --resume")
        raise typer.Exit(STOPPED)
    console.print(
        f"{result.archive}: validation MAE at 80 m {result.state.best_score:.3f} m, of iteration "
        f"{result.state.best_step}; curves are in {out}"
    )


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
