"""`radcam-depth` on a disk that is full or read-only: no file grows beyond a size, or nothing in a folder is written.

python -m benchmarks.adversary.victim 500 replay drive.mcap out.mcap
python -m benchmarks.adversary.victim FOLDER replay drive.mcap FOLDER/out.mcap
"""

from __future__ import annotations

import errno
import os
import resource
import sys
from pathlib import Path
from typing import Any

from radcam_depth_ros import cli

_CHANGING = {"os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.symlink", "os.truncate"}


def limit(room: int) -> None:
    """No file may become larger than so many bytes."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))


def forbid(folder: str) -> None:
    """What Python would change in a folder fails as on a read-only disk; root may write whatever its mode says."""

    def refuse(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            path, _, flags = arguments
            if not (flags or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
                return
        elif event in _CHANGING:
            path = arguments[0]
        else:
            return
        if isinstance(path, (str, os.PathLike)) and Path(path).absolute().is_relative_to(folder):
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))

    sys.addaudithook(refuse)


def main() -> None:
    """Limits, and runs the command."""
    limited = sys.argv.pop(1)
    if limited.isdecimal():
        limit(int(limited))
    elif limited != "-":
        forbid(limited)
    cli.main()


if __name__ == "__main__":
    main()
