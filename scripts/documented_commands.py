"""Executes the commands of README, docs and `--help`: `make docs`, `make docs PAGES="docs/training.md README.md:189"`.

A page is a story: its blocks are executed in their order in one folder, a copy of the checkout; with a line behind the
page's name those from that line on. What a reader does not see says how:

    <!-- before: COMMANDS --> above a block is executed first, for what the page takes as given; $DRIVE is a drive.
    <!-- executed with: SCRIPT --> above a block changes it by `sed -E`, such as a training's length.
    Not executed here: REASON. below a block says that it is not; above the first one, that none of the page is.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from radcam_depth_ros.cli import app

ROOT = Path(__file__).parents[1]
HELP = "--help"
"""The page of the examples that end each verb's help."""
DRIVE_FRAMES = 6
LIMIT_S = 1800
_OWN = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
"""Variables of this process alone: each Python of the environment finds ROS's libraries by itself."""
_BLOCK = re.compile(
    r"(?:^<!-- before: (?P<before>.*?) -->\n)?(?:^<!-- executed with: (?P<edit>.*?) -->\n)?"
    r"^```bash\n(?P<text>.*?)^```\n(?:\n?Not executed here: (?P<reason>.*?)\.\n)?",
    re.M | re.S,
)
_WHOLE_PAGE = re.compile(r"^Not executed here: (.*?)\.$", re.M | re.S)


@dataclass(frozen=True)
class Block:
    """Commands that stand together.

    Attributes:
        page: The file that has them.
        line: Of the first command.
        text: The commands.
        before: Commands that make what they take as given.
        edit: What `sed -E` changes of them.
        reason: Why they are not executed here; empty where they are.
    """

    page: str
    line: int
    text: str
    before: str = ""
    edit: str = ""
    reason: str = ""


def pages(root: Path = ROOT) -> tuple[str, ...]:
    """All pages, as paths from the checkout's root."""
    folders = [root / folder / "README.md" for folder in ("benchmarks", "experiments")]
    found = [root / "README.md", *folders, *(root / "docs").rglob("*.md")]
    return tuple(sorted(str(path.relative_to(root)) for path in found))


def read_blocks(page: str, root: Path = ROOT) -> tuple[Block, ...]:
    """A page's blocks, in their order."""
    if page == HELP:
        return tuple(Block(page, 0, example) for example in examples())
    text = (root / page).read_text(encoding="utf-8")
    found = list(_BLOCK.finditer(text))
    whole = _WHOLE_PAGE.search(text[: found[0].start()]) if found else None
    return tuple(
        Block(
            page,
            text.count("\n", 0, match.start("text")) + 1,
            match["text"],
            match["before"] or "",
            match["edit"] or "",
            whole[1] if whole else match["reason"] or "",
        )
        for match in found
    )


def examples() -> tuple[str, ...]:
    """The example of each verb's help, and of the whole command's."""
    helps = [str(app.info.help), *(str(command.callback.__doc__) for command in app.registered_commands)]
    return tuple(" ".join(example.split()) for text in helps for example in text.split("Example: ")[1:])


def commands(block: Block) -> str:
    """What is executed of a block."""
    if not block.edit:
        return block.text
    edited = subprocess.run(["sed", "-E", block.edit], input=block.text, capture_output=True, text=True, check=True)
    return edited.stdout


def _copy(folder: Path) -> None:
    """The checkout as git has it, without its history; the environment is the checkout's own."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    for name in filter(None, listed.stdout.decode().split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    (folder / ".venv").symlink_to(Path(sys.prefix))
    for name in ("setup.py", "setup.cfg", "constraints.txt", "scripts/make_venv"):
        os.utime(folder / name, (0, 0))  # so that make does not install anew


def _run(text: str, folder: Path, drive: Path) -> tuple[bool, str]:
    """Executes commands until one fails: whether all went well, and what they printed."""
    environment = {
        **{name: value for name, value in os.environ.items() if name not in _OWN},
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "PYTHONPATH": str(folder),
        "DRIVE": str(drive),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(folder / "out" / "ros_log"),
    }
    process = subprocess.Popen(
        ["bash", "-euo", "pipefail", "-c", text],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    try:
        printed, _ = process.communicate(timeout=LIMIT_S)
    except subprocess.TimeoutExpired as error:
        printed = (error.stdout or b"") + f"\nnot done after {LIMIT_S} s".encode()
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)  # with what it left running
        process.wait()
    return process.returncode == 0, printed.decode(errors="replace")


def _tell(block: Block) -> Iterator[str]:
    """A block's commands, each on a line."""
    yield from (f"        {line}" for line in commands(block).strip().splitlines())


def execute(page: str, drive: Path) -> int:
    """Executes a page, or its end, and prints what became of each block; the number of those that failed."""
    page, _, first_line = page.partition(":")
    failures = 0
    with tempfile.TemporaryDirectory(prefix="radcam_depth_docs.") as temporary:
        folder = Path(temporary)
        _copy(folder)
        for block in read_blocks(page):
            if first_line and block.line < int(first_line):
                continue
            where = f"{block.page}:{block.line}" if block.line else block.page
            if block.reason:
                print(f"not here  {where}: {' '.join(block.reason.split())}", flush=True)
                continue
            started_s = time.monotonic()
            is_well, printed = _run(block.before, folder, drive)
            if is_well:
                is_well, printed = _run(commands(block), folder, drive)
            print(f"{'ok' if is_well else 'FAILED':8}  {where}, {time.monotonic() - started_s:.0f} s")
            print(*_tell(block), sep="\n", flush=True)
            if not is_well:
                failures += 1
                print(*(f"      | {line}" for line in printed.splitlines()[-40:]), sep="\n", flush=True)
    return failures


def main(arguments: Sequence[str]) -> None:
    """Executes pages, all of them if none is named."""
    known = (HELP, *pages())
    unknown = [page for page in arguments if page.partition(":")[0] not in known]
    if unknown:
        sys.exit(f"there is no page {unknown[0]}; there are {', '.join(known)}")
    with tempfile.TemporaryDirectory(prefix="radcam_depth_docs.") as temporary:
        drive = Path(temporary) / "drive.mcap"
        is_well, printed = _run(f"radcam-depth simulate {drive} --seed 7 --frames {DRIVE_FRAMES}", ROOT, drive)
        if not is_well:
            sys.exit(printed)
        failures = sum(execute(page, drive) for page in arguments or known)
    if failures:
        sys.exit(f"{failures} blocks failed")


if __name__ == "__main__":
    main(sys.argv[1:])
