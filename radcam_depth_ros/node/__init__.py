"""The live ROS 2 node: lifecycle, quality of service, back-pressure, diagnostics, publishing."""

from __future__ import annotations

import sys
from typing import NoReturn

from radcam_depth_ros.extras import install_extra

__all__ = ["main"]


def main(args: list[str] | None = None) -> NoReturn:
    """Runs the node as `node.process.main` does; where ROS is missing, ends with one sentence and exit code 2."""
    try:
        from radcam_depth_ros.node.process import main as run
    except ModuleNotFoundError as error:
        print(
            f"radcam_depth_node: the node needs ROS 2, and the package {error.name} is not installed; source ROS "
            f"(source /opt/ros/jazzy/setup.bash), or {install_extra('ros')}",
            file=sys.stderr,
        )
        sys.exit(2)
    run(args)
