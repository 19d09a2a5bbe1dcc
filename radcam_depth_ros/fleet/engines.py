"""Where drives are worked on, by name."""

from __future__ import annotations

from radcam_depth_ros.fleet.errors import FleetError
from radcam_depth_ros.fleet.running import Engine, run_here


def engine_of(name: str | None) -> Engine:
    """The engine of `--on`.

    Raises:
        FleetError: for a name that is none, an engine that is not installed, or a cluster that does not answer.
    """
    if name is None or name == "local":
        return run_here
    if name == "ray" or name.startswith("ray://"):
        from radcam_depth_ros.fleet.on_ray import ray_engine

        return ray_engine(name)
    raise FleetError(f"expected local, ray or ray://HOST:PORT for --on, got {name!r}")
