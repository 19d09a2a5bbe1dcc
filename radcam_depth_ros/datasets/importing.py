"""Imports scenes of a data set, several at once: one bag a scene; a scene that fails leaves the others alone."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

from radcam_depth_ros.bags import BagError, BagReader, read_scenario
from radcam_depth_ros.datasets.errors import DatasetError
from radcam_depth_ros.datasets.layout import DatasetLayout, ImportOptions
from radcam_depth_ros.datasets.scene_bag import SceneImport, write_scene
from radcam_depth_ros.datasets.splits import scenes_of, split_of
from radcam_depth_ros.datasets.tables import Scene, Tables
from radcam_depth_ros.frame import RadcamDepthError


@dataclass(frozen=True)
class ImportPlan:
    """What is imported.

    Attributes:
        root: The data set's folder.
        layout: Which data set it is.
        tables: Its tables.
        scenes: The scenes.
        options: What is taken of each.
        out: Folder of the bags.
    """

    root: Path
    layout: DatasetLayout
    tables: Tables
    scenes: tuple[Scene, ...]
    options: ImportOptions
    out: Path

    @property
    def made_with(self) -> str:
        """The data set, its version and the options, by which a bag tells what it was made with."""
        return f"{self.layout.name} {self.tables.version} {self.options.describe(self.layout)}"

    def bag(self, scene: Scene) -> Path:
        """Where a scene is written."""
        return self.out / f"{scene.name}.mcap"


@dataclass(frozen=True)
class ImportedScene:
    """What became of a scene.

    Attributes:
        name: The scene.
        problem: Why it has no bag, as a sentence; empty where it has.
        was_there: Its bag was there before.
    """

    name: str
    problem: str = ""
    was_there: bool = False


def plan_import(
    layout: DatasetLayout,
    root: Path,
    out: Path,
    options: ImportOptions,
    *,
    version: str,
    names: Sequence[str] = (),
    split: str | None = None,
) -> ImportPlan:
    """Reads the small tables and chooses the scenes.

    Args:
        layout: Which data set it is.
        root: Its folder.
        out: Folder of the bags.
        options: What is taken of each scene.
        version: Name of the tables' folder.
        names: Of scenes; empty for all.
        split: Only the scenes of this one of `SPLITS`.

    Raises:
        DatasetError: for tables that are not there, and scenes or a split that they do not have.
    """
    if out.suffix == ".mcap" or out.is_file():
        raise DatasetError(f"expected a folder for the bags of scenes, got the file {out}; name a folder")
    tables = Tables(root, version)
    known = [scene.name for scene in tables.scenes]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise DatasetError(
            f"expected scenes of {root / version}, got {', '.join(unknown)}; it has {len(known)}: {some_names(known)}"
        )
    chosen = set(names or known)
    if split is not None:
        if not layout.has_splits:
            raise DatasetError(f"{layout.title} has other splits than nuScenes; name its scenes by --scenes")
        chosen &= set(scenes_of(split, known, version))
    if not chosen:
        raise DatasetError(f"expected some scenes to import, got none of those named in the split {split}")
    scenes = tuple(scene for scene in tables.scenes if scene.name in chosen)
    return ImportPlan(root, layout, tables, scenes, options, out)


def import_scenes(
    plan: ImportPlan,
    jobs: int = 1,
    *,
    overwrite: bool = False,
    tick: Callable[[int], None] = lambda rows: None,
    done: Callable[[ImportedScene], None] = lambda scene: None,
) -> tuple[ImportedScene, ...]:
    """Writes a bag for each scene of a plan; those that are there already, made with the same options, are kept.

    A bag that is there and cannot be read fails its scene: it may be somebody's recording.

    Args:
        plan: What to import.
        jobs: Scenes at once, each in a process, at least 1.
        overwrite: Make bags anew that are there.
        tick: See `Tables.records`.
        done: Called with each scene that is ready or failed.

    Raises:
        DatasetError: for tables that cannot be read, or a bag that is there and was made with other options.
    """
    if jobs < 1:
        raise DatasetError(f"expected at least 1 process for --jobs, got {jobs}")
    results = []

    def report(result: ImportedScene) -> None:
        results.append(result)
        done(result)

    found = {} if overwrite else {scene.name: _found(plan, scene) for scene in plan.scenes}
    todo = [scene for scene in plan.scenes if found.get(scene.name) is None]
    for there in found.values():
        if there is not None:
            report(there)
    if not todo:
        return tuple(results)
    numbered = (
        SceneImport(
            plan.root,
            plan.layout.name,
            plan.tables.version,
            split_of(records.scene.name, plan.tables.version) if plan.layout.has_splits else "",
            plan.made_with,
            records,
            plan.bag(records.scene),
            overwrite,
        )
        for records in plan.tables.records(todo, plan.layout, plan.options, tick)
    )
    if jobs == 1:
        for job in numbered:
            report(_imported(job))
        return tuple(results)
    # spawn: a forked child of a process that has used threads may hang.
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        waiting: set[Future[ImportedScene]] = set()
        try:
            for job in numbered:
                waiting.add(pool.submit(_imported, job))
                if len(waiting) > jobs:  # no more scenes are held than are needed
                    waiting = _told(waiting, report)
            while waiting:
                waiting = _told(waiting, report)
        except BrokenProcessPool:
            raise DatasetError(
                "a process that imported a scene was killed, most likely since memory ran out; import fewer at once "
                f"(--jobs, now {jobs}), what is written is kept"
            ) from None
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return tuple(results)


def _told(waiting: set[Future[ImportedScene]], report: Callable[[ImportedScene], None]) -> set[Future[ImportedScene]]:
    """Waits for some scene; gives back those that are still waited for."""
    done, rest = wait(waiting, return_when=FIRST_COMPLETED)
    for future in done:
        report(future.result())
    return rest


def _imported(job: SceneImport) -> ImportedScene:
    try:
        write_scene(job)
    except RadcamDepthError as error:
        return ImportedScene(job.records.scene.name, str(error))
    return ImportedScene(job.records.scene.name)


def _found(plan: ImportPlan, scene: Scene) -> ImportedScene | None:
    """The scene, where its bag is there, whole or not; DatasetError for one that was made of something else."""
    bag = plan.bag(scene)
    if not bag.exists():
        return None
    try:
        with BagReader(bag) as reader:
            made_with = read_scenario(reader).get("imported", "something else")
    except BagError as error:
        return ImportedScene(scene.name, f"{bag} is there and cannot be read; remove it, and import again ({error})")
    if made_with != plan.made_with:
        raise DatasetError(
            f"expected {bag} to be made of {plan.made_with}, got {made_with}; choose another folder, or --overwrite"
        )
    return ImportedScene(scene.name, was_there=True)


def some_names(names: Sequence[str]) -> str:
    """Names for a sentence: all of them, or the first and the last."""
    return ", ".join(names) if len(names) <= 4 else f"{', '.join(names[:3])} ... {names[-1]}"
