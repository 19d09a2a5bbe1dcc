"""The command `radcam-depth`; each verb has a module."""

from __future__ import annotations

import errno
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from itertools import zip_longest

import typer

from radcam_depth_ros import openmp
from radcam_depth_ros.cli.bench import bench
from radcam_depth_ros.cli.check_calibration import check_calibration
from radcam_depth_ros.cli.datasets import export_dataset, import_
from radcam_depth_ros.cli.evaluate import evaluate
from radcam_depth_ros.cli.export import export
from radcam_depth_ros.cli.inspect import inspect
from radcam_depth_ros.cli.merge import merge
from radcam_depth_ros.cli.networks import networks
from radcam_depth_ros.cli.play import play
from radcam_depth_ros.cli.replay import replay
from radcam_depth_ros.cli.simulate import simulate
from radcam_depth_ros.cli.train import train
from radcam_depth_ros.cli.view import view
from radcam_depth_ros.printable import printable

BAD_INPUT = 2
"""Exit code for errors that a user can fix; the message on stderr says how."""

app = typer.Typer(
    name="radcam-depth",
    help="Metric depth images from one camera and its radars: simulate, import, replay, evaluate, train, measure.\n\n"
    "Example: radcam-depth simulate out/first --seed 7 --frames 20 && radcam-depth evaluate out/first --json -",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
_VERBS = (
    *(simulate, replay, evaluate, merge, train, export, networks, inspect, check_calibration, play, view, bench),
    *(import_, export_dataset),
)
for verb in _VERBS:
    app.command(verb.__name__.rstrip("_").replace("_", "-"))(verb)


def _spelled_out(arguments: Sequence[str]) -> Iterator[str]:
    """The arguments, with `-` for stdout after a `--json` that no file follows."""
    for argument, following in zip_longest(arguments, arguments[1:], fillvalue="--"):
        yield argument
        if argument == "--json" and following != "-" and following.startswith("-"):
            yield "-"


def _warning_line(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    """A warning as its sentence alone, without the line of code that it comes from."""
    return f"radcam-depth: {printable(str(message))}\n"


def main() -> None:
    """Runs the command; a user's mistake ends with one sentence and exit code 2."""
    openmp.prepare()
    warnings.formatwarning = _warning_line
    # As after Ctrl-C, half-written files go: by default, SIGTERM would end the process where it stands.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        app(list(_spelled_out(sys.argv[1:])))
    except OSError as error:
        if error.errno not in _DISK_ERRORS:
            raise
        _refuse(
            f"{error.filename or 'a file'}: {error.strerror}; make room, mend its permissions, or choose another place"
        )
    except Exception as error:
        from radcam_depth_ros.frame import RadcamDepthError  # here, since it brings numpy, which --help can do without

        if not isinstance(error, RadcamDepthError):
            raise
        _refuse(str(error))


_DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EFBIG, errno.EACCES, errno.EPERM)


def _refuse(sentence: str) -> None:
    print(f"radcam-depth: {printable(sentence)}", file=sys.stderr)
    sys.exit(BAD_INPUT)
