"""Works on drives as tasks of Ray, on all nodes of a cluster.

Ray schedules, moves values and tries again where a worker or a node dies. Results come to this process, which alone
writes them: a cluster needs no shared folder for them, but one (or storage) for bags.
"""

from __future__ import annotations

import json
import platform
import sys
from collections.abc import Iterable, Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice
from typing import Any

from radcam_depth_ros import __version__
from radcam_depth_ros.extras import install_extra
from radcam_depth_ros.fleet.errors import FleetError
from radcam_depth_ros.fleet.results import Done, Failed
from radcam_depth_ros.fleet.running import Engine, attempt
from radcam_depth_ros.fleet.unit import Unit, Work, Worker

RETRIES = 3
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
        raise FleetError(f"--on ray needs the package ray, which is not installed; {install_extra('fleet')}") from error
    own = {} if address == "ray" else {"address": address}
    try:
        ray.init(ignore_reinit_error=True, log_to_driver=False, logging_level="ERROR", **own)
    except Exception as error:  # of many kinds, by the way that a cluster is reached
        reason = " ".join(str(error).split())[:300]
        raise FleetError(
            f"cannot join the Ray cluster {address}: {reason}; check that it runs and that its Python and Ray are "
            f"those of this computer (Python {platform.python_version()}, Ray {ray.__version__})"
        ) from None
    _require_same_versions(ray)

    def engine(work: Work, out: str, units: Iterable[Unit]) -> Iterator[tuple[Unit, Done | Failed]]:
        # Ray tells of workers that die on stdout, which may be for JSON.
        with redirect_stdout(sys.stderr):
            try:
                yield from _outcomes(ray, work, out, units)
            finally:
                ray.shutdown()

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
    tasks = _Tasks(ray, work, out)
    todo, died = iter(units), []
    while True:
        # Few more than can run: memory stays what it is, and later drives ask for what is known then.
        for unit in islice(todo, tasks.room()):
            tasks.submit(unit)
        if not tasks.waiting:
            break
        for unit, outcome in tasks.next():
            if outcome is None:
                died.append(unit)
            else:
                yield unit, outcome
    for unit in died:
        # Alone: one drive that ends its worker may have taken its neighbours with it.
        tasks.submit(unit)
        for _, outcome in tasks.next():
            yield unit, outcome or Failed(f"{unit.place}: its worker died again and again, or its memory ran out")


class _Tasks:
    """Drives that the cluster works on."""

    def __init__(self, ray: Any, work: Work, out: str) -> None:
        self._ray, self._out, self._threads = ray, out, work.threads
        key = json.dumps([work.verb, work.settings()], sort_keys=True)
        self._shared, self._task = ray.put(_Shared(key, work)), ray.remote(_do)
        self._need_mb = 0.0
        self.waiting: dict[Any, Unit] = {}

    def room(self) -> int:
        """How many more drives may wait."""
        cores = int(self._ray.cluster_resources().get("CPU", 1))
        return max(0, 2 * max(1, cores // self._threads) - len(self.waiting))

    def submit(self, unit: Unit) -> None:
        """Hands a drive to Ray, with the cores and the memory that it needs."""
        # More than any node has would wait for ever.
        nodes = [node["Resources"].get("memory", 0.0) for node in self._ray.nodes() if node["Alive"]]
        memory = int(min(MORE * (self._need_mb or FIRST_MEMORY_MB) * 1024**2, max(nodes, default=0.0)))
        options = {"num_cpus": self._threads, "memory": memory, "max_retries": RETRIES}
        self.waiting[self._task.options(**options).remote(self._shared, self._out, unit)] = unit

    def next(self) -> Iterator[tuple[Unit, Done | Failed | None]]:
        """The next drives that are done; None for one whose workers died."""
        done, _ = self._ray.wait(list(self.waiting), num_returns=1)
        for reference in done:
            unit = self.waiting.pop(reference)
            try:
                outcome: Done | Failed = self._ray.get(reference)
            except self._ray.exceptions.RayError:
                yield unit, None
                continue
            if isinstance(outcome, Done):
                self._need_mb = max(self._need_mb, outcome.memory_mb)
            yield unit, outcome
