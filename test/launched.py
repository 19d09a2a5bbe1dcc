"""Launches the package's launch files with `launch` and `launch_ros`, where they are installed.

Both are in no package registry. Each file is launched in a process of its own with executables in the nodes' place that
write down what they were started with: names, remappings, and the parameters as rclpy reads them.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PACKAGE = "radcam_depth_ros"
RUN = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import AnyLaunchDescriptionSource
path, *arguments = sys.argv[1:]
given = [tuple(argument.split(":=", 1)) for argument in arguments]
service = LaunchService(argv=arguments)
service.include_launch_description(
    LaunchDescription([IncludeLaunchDescription(AnyLaunchDescriptionSource(path), launch_arguments=given)])
)
sys.exit(service.run())
"""
"""What `ros2 launch` does."""
STAND_IN = """#!{python}
import json, os, sys, time
import rclpy
from rclpy.node import Node
arguments = sys.argv[1:]
rclpy.init(args=arguments)
node = Node("unnamed")
given = node._parameter_overrides  # rclpy can't declare the empty lists of config/node.yaml by itself
parameters = {{name: list(p.value) if hasattr(p.value, "tolist") else p.value for name, p in given.items()}}
topics = {{topic: node.resolve_topic_name(topic) for topic in {topics!r}}}
told = dict(name=node.get_name(), namespace=node.get_namespace(), parameters=parameters, topics=topics)
with open(os.path.join({folder!r}, f"{executable}-{{os.getpid()}}.json"), "w") as file:
    json.dump(told, file)
"""
PLAYER = """#!{python}
import json, os, sys
with open({path!r}, "w") as file:
    json.dump([os.path.basename(sys.argv[0]), *sys.argv[1:]], file)
"""


def has_launch() -> bool:
    """Whether ROS's launch is installed; the checkout's folder of that name is not it."""
    try:
        return (
            importlib.util.find_spec("launch.actions") is not None
            and importlib.util.find_spec("launch_ros") is not None
        )
    except ModuleNotFoundError:
        return False


def executable(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    path.chmod(0o755)


class Launched:
    """Launches files in an install space with stand-ins for the node and for both players.

    Args:
        folder: Temporary, its own.
        topics: Relative topics that each node tells where they are.
    """

    def __init__(self, folder: Path, topics: Sequence[str]) -> None:
        self.share = folder / "share" / PACKAGE
        self._told = folder / "told"
        self._told.mkdir()
        self._folder = folder
        self._topics = tuple(topics)
        self.share_of(PACKAGE)
        self.install(PACKAGE, "radcam_depth_node")
        for name in ("config", "launch", "rviz"):
            (self.share / name).symlink_to(ROOT / name)
        player = PLAYER.format(python=sys.executable, path=str(self._told / "played.json"))
        executable(folder / "bin" / "ros2", player)
        executable(folder / "lib" / PACKAGE / "radcam-depth", player)

    def share_of(self, package: str) -> Path:
        """Makes a package known; its share folder."""
        index = self._folder / "share" / "ament_index" / "resource_index" / "packages"
        index.mkdir(parents=True, exist_ok=True)
        (index / package).touch()
        share = self._folder / "share" / package
        share.mkdir(exist_ok=True)
        return share

    def install(self, package: str, name: str) -> None:
        """Puts a stand-in for a package's executable into the install space."""
        self.share_of(package)
        text = STAND_IN.format(python=sys.executable, topics=self._topics, folder=str(self._told), executable=name)
        executable(self._folder / "lib" / package / name, text)

    def including(self, xml: str) -> str:
        """The path of a launch file of another package."""
        path = self._folder / "stack.launch.xml"
        path.write_text(f"<launch>{xml}</launch>", encoding="utf-8")
        return str(path)

    def _run(self, name: str, arguments: Sequence[str]) -> int:
        environment = os.environ | {
            "AMENT_PREFIX_PATH": os.pathsep.join((str(self._folder), os.environ.get("AMENT_PREFIX_PATH", sys.prefix))),
            "PATH": os.pathsep.join((str(self._folder / "bin"), os.environ["PATH"])),
            "PYTHONPATH": os.pathsep.join(path for path in sys.path if path and Path(path) != ROOT),
            "ROS_LOG_DIR": str(self._folder / "log"),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        command = [sys.executable, "-c", RUN, str(self.share / "launch" / name), *arguments]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=self._folder)
        self.output = done.stdout + done.stderr
        return done.returncode

    def run(self, name: str, *arguments: str) -> list[dict[str, Any]]:
        """What this package's nodes were started with, by namespace and name.

        Raises:
            AssertionError: with launch's output, where it failed.
        """
        assert self._run(name, arguments) == 0, self.output
        told = self.started("radcam_depth_node")
        assert told, self.output
        return told

    def refused(self, name: str, *arguments: str) -> str:
        """What launch ends with, which must have started nothing.

        Raises:
            AssertionError: with launch's output, where it did not fail or had started something.
        """
        assert self._run(name, arguments), self.output
        assert not list(self._told.iterdir()), self.output
        assert "process started" not in self.output
        (line,) = [line for line in self.output.splitlines() if "Caught exception in launch" in line]
        return line

    def started(self, executable: str) -> list[dict[str, Any]]:
        """What an executable was started with, each time, by namespace and name."""
        told = [json.loads(path.read_text(encoding="utf-8")) for path in self._told.glob(f"{executable}-*.json")]
        return sorted(told, key=lambda node: (node["namespace"], node["name"]))

    def played(self) -> Sequence[str]:
        """The player's name and arguments."""
        arguments: list[str] = json.loads((self._told / "played.json").read_text(encoding="utf-8"))
        return arguments
