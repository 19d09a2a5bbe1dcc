"""Works on drives as tasks of Ray, on all nodes of a cluster.

Ray schedules, moves values and tries again where a worker or a node dies. Results come to this process, which alone
writes them: a cluster needs no shared folder for them, but one (or storage) for bags.
"""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice
from typing import Any

from radcam_depth_ros import __version__
from radcam_depth_ros.fleet.errors import FleetError
from radcam_depth_ros.fleet.results import Done, Failed
from radcam_depth_ros.fleet.running import Engine, attempt
from radcam_depth_ros.fleet.unit import Unit, Work, Worker

RETRIES = 5
"""How often Ray does a drive again whose worker or node died."""
FIRST_MEMORY_MB = 2000.0
"""Asked for until a drive has told how much it needs (`python -m benchmarks.fleet`)."""
MORE = 1.2
"""Asked for more than the most that a drive has needed."""


@dataclass(frozen=True)
class _Shared:
    """Work that is put into the cluster once.

    Attributes:
        key: By which a process knows that it has opened it already.
        work: The work.
    """

    key: str
    work: Work = field(compare=False)


@lru_cache(maxsize=1)
def _opened(shared: _Shared) -> Worker:
    return shared.work.open()


def _do(shared: _Shared, out: str, unit: Unit) -> Done | Failed:
    """One drive, in a process of the cluster."""
    try:
        worker = _opened(shared)
    except Exception as error:
        return Failed(f"a worker could not begin: {error}")
    return attempt(shared.work, worker, out, unit)


def ray_engine(address: str) -> Engine:
    """Connects to a cluster, or starts one on this computer.

    Args:
        address: `ray` for the one of `RAY_ADDRESS` or of this computer, else `ray://HOST:PORT`.

    Raises:
        FleetError: when Ray is not installed, the cluster does not answer, or a node has another version.
    """
    try:
        import ray
    except ModuleNotFoundError as error:
        raise FleetError(
            "--on ray needs the package ray, which is not installed; install the extra `fleet` of this package with pip"
        ) from error
    if not ray.is_initialized():
        try:
            ray.init(
                address=None if address == "ray" else address,
                log_to_driver=False,
                logging_level="ERROR",
                **({} if "://" in address else {"include_dashboard": None}),
            )
        except Exception as error:  # of many kinds, by the way that a cluster is reached
            reason = " ".join(str(error).split())[:300]
            raise FleetError(
                f"cannot join the Ray cluster {address}: {reason}; check that it runs and that its Python and Ray are "
                f"those of this computer (Python {platform.python_version()}, Ray {ray.__version__})"
            ) from None
    _require_same_versions(ray)

    def engine(work: Work, out: str, units: Iterable[Unit]) -> Iterator[tuple[Unit, Done | Failed]]:
        return _outcomes(ray, work, out, units)

    return engine


def _require_same_versions(ray: Any) -> None:
    """Asks each node for its versions; FleetError where one differs."""
    own = (__version__, ".".join(platform.python_version_tuple()[:2]))

    def versions() -> tuple[str, str]:  # sent by value, since a node may not have this package
        import importlib
        import platform as here

        try:
            version = str(importlib.import_module("radcam_depth_ros").__version__)
        except ImportError:
            version = "none"
        return version, ".".join(here.python_version_tuple()[:2])

    on_node = ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy
    asked = {
        node["NodeManagerHostname"]: ray.remote(versions)
        .options(num_cpus=0, scheduling_strategy=on_node(node["NodeID"], soft=False))
        .remote()
        for node in ray.nodes()
        if node["Alive"]
    }
    for host, reference in asked.items():
        found = ray.get(reference)
        if found != own:
            raise FleetError(
                f"expected version {own[0]} of radcam_depth_ros with Python {own[1]} on the node {host}, got "
                f"{found[0]} with Python {found[1]}; install the same on all nodes"
            )


def _outcomes(ray: Any, work: Work, out: str, units: Iterable[Unit]) -> Iterator[tuple[Unit, Done | Failed]]:
    shared = ray.put(_Shared(repr(sorted(work.settings().items())), work))
    submit = _submitter(ray, work, shared, out)
    waiting: dict[Any, Unit] = {}
    todo, need_mb = iter(units), FIRST_MEMORY_MB
    while True:
        # Few more than can run: values that wait are no memory of this process, and later drives ask for what is known.
        room = 2 * max(1, int(ray.cluster_resources().get("CPU", 1)) // max(1, work.threads)) - len(waiting)
        for unit in islice(todo, max(0, room)):
            waiting[submit(unit, need_mb)] = unit
        if not waiting:
            return
        done, _ = ray.wait(list(waiting), num_returns=1)
        for reference in done:
            unit = waiting.pop(reference)
            outcome = _outcome(ray, reference, unit)
            if isinstance(outcome, Done):
                need_mb = max(MORE * outcome.memory_mb, need_mb if need_mb != FIRST_MEMORY_MB else 0.0)
            yield unit, outcome


def _submitter(ray: Any, work: Work, shared: Any, out: str) -> Callable[[Unit, float], Any]:
    task = ray.remote(_do)
    largest = max((node["Resources"].get("memory", 0.0) for node in ray.nodes() if node["Alive"]), default=0.0)

    def submit(unit: Unit, need_mb: float) -> Any:
        # More than any node has would wait for ever.
        memory = int(min(need_mb * 1024**2, largest))
        return task.options(num_cpus=work.threads, memory=memory, max_retries=RETRIES).remote(shared, out, unit)

    return submit


def _outcome(ray: Any, reference: Any, unit: Unit) -> Done | Failed:
    try:
        outcome: Done | Failed = ray.get(reference)
    except ray.exceptions.RayError as error:
        first = str(error).strip().splitlines()[0]
        return Failed(f"{unit.place}: its worker died {RETRIES + 1} times ({type(error).__name__}: {first})")
    return outcome
