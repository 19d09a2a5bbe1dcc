"""Builds the wheels of what is checked out, and tries them: `release.py`; `release.py X.Y.Z` makes that version.

A version is written, with the changelog's section, in a copy. The checkout gets both, and `dist/` the wheels, only once
all checks have passed. Nothing is committed, tagged or uploaded: the last lines say how.
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
UNRELEASED = "Forthcoming"
"""The head of what is not released yet, as catkin_pkg names it (REP 132)."""
WHEELS = (".", "release/weights")
"""Folders with a setup.py each."""
WRITTEN = ("CHANGELOG.rst", "CITATION.cff", "docs/references.md", "package.xml", "radcam_depth_ros/__init__.py")
"""Files that have the version."""


class ReleaseError(Exception):
    """Why there can be no release, as a sentence."""


def released(changelog: str, version: str, date: datetime.date) -> str:
    """The changelog with its unreleased section as that of a version.

    Args:
        changelog: In the format of REP 132, newest section first.
        version: For example 1.2.3.
        date: Of the release.

    Raises:
        ReleaseError: when there is no unreleased section, nothing in it, or the version has a section already.
    """
    if re.search(rf"^{re.escape(version)} \(", changelog, re.M):
        raise ReleaseError(f"CHANGELOG.rst has a section {version} already; give a later version")
    found = re.search(rf"^{UNRELEASED}\n-+\n(\* .*)?", changelog, re.M)
    if not found or not found[1]:
        raise ReleaseError(
            f"expected a section {UNRELEASED!r} with at least one line `* ...` in CHANGELOG.rst, got none; "
            "write down what has changed"
        )
    head = f"{version} ({date.isoformat()})"
    return changelog[: found.start()] + f"{head}\n{'-' * len(head)}\n{found[1]}" + changelog[found.end() :]


def require_releasable(version: str, current: str, changes: str, tags: str) -> None:
    """Refuses a version that cannot be made.

    Args:
        version: The version that is asked for.
        current: The version of package.xml.
        changes: What `git status --porcelain` prints.
        tags: What `git tag` prints.

    Raises:
        ReleaseError: which says what to do.
    """
    if not re.fullmatch(r"(0|[1-9]\d*)(\.(0|[1-9]\d*)){2}", version):
        raise ReleaseError(f"a version is three numbers such as 1.2.3, got {version!r}")
    if version in tags.split():
        raise ReleaseError(f"the tag {version} exists; give a later version")
    if _numbers(version) < _numbers(current):
        raise ReleaseError(f"expected a version from {current} on, got {version}")
    if changes.strip():
        raise ReleaseError(f"the checkout has changes that are not committed; commit them first:\n{changes.rstrip()}")


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(map(int, version.split(".")))


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def _current() -> str:
    (found,) = re.findall(r"<version>(.*)</version>", (ROOT / "package.xml").read_text(encoding="utf-8"))
    return str(found)


def copy_checkout(folder: Path) -> None:
    """Copies what git tracks, as it is in the checkout: builds leave files beside the sources."""
    for name in filter(None, _git("ls-files", "-z").split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)


def write_version(folder: Path, version: str) -> None:
    """Writes a version and the changelog's section into a copy of the checkout."""
    changelog, manifest = folder / "CHANGELOG.rst", folder / "package.xml"
    text = released(changelog.read_text(encoding="utf-8"), version, datetime.date.today())
    changelog.write_text(text, encoding="utf-8")
    text = re.sub(r"<version>.*</version>", f"<version>{version}</version>", manifest.read_text(encoding="utf-8"))
    manifest.write_text(text, encoding="utf-8")
    _run(folder, "scripts/generate_pages.py")


def _run(folder: Path, *words: str) -> None:
    """Runs Python in a folder, whose package it takes."""
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    if subprocess.run([sys.executable, *words], cwd=folder, env=environment, check=False).returncode:
        raise ReleaseError(f"this failed: python {' '.join(words)}")


def build(folder: Path) -> Path:
    """Builds and checks the wheels of a copy; gives their folder, with the bill of materials and the hashes."""
    dist = folder / "dist"
    for project in WHEELS:
        _run(folder, "-m", "build", "--no-isolation", "--wheel", "--outdir", "dist", project)
    wheels = sorted(dist.glob("*.whl"))
    _run(folder, "-m", "twine", "check", "--strict", *map(str, wheels))
    package = next(wheel for wheel in wheels if wheel.name.startswith("radcam_depth_ros-"))
    bill = dist / f"{'-'.join(package.name.split('-')[:2])}.cdx.json"
    _run(folder, "scripts/check_wheel.py", "dist", "--sbom", str(bill))
    lines = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in (*wheels, bill)]
    (dist / "SHA256SUMS").write_text("".join(lines), encoding="utf-8")
    return dist


def release(version: str | None) -> None:
    """Builds and tries the wheels; of a version where one is given."""
    if version:
        require_releasable(version, _current(), _git("status", "--porcelain"), _git("tag"))
    with tempfile.TemporaryDirectory(prefix="release_") as place:
        folder = Path(place)
        copy_checkout(folder)
        if version:
            write_version(folder, version)
        dist = build(folder)
        shutil.rmtree(ROOT / "dist", ignore_errors=True)
        shutil.copytree(dist, ROOT / "dist")
        if version:
            for name in WRITTEN:
                shutil.copyfile(folder / name, ROOT / name)
    print("dist/ has the wheels, the bill of materials (CycloneDX) and SHA256SUMS")
    if version:
        print(
            "the changelog and the version are written. What is left (docs/release.md):\n"
            f'    git commit -am "Release {version}" && git tag -a {version} -m "Release {version}"\n'
            f"    git push origin HEAD {version} && twine upload dist/*.whl"
        )


def main(arguments: list[str]) -> int:
    """1 and a sentence where there can be no release."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("version", nargs="?", help="version to make, such as 1.2.3; none: the checkout as it is")
    try:
        release(parser.parse_args(arguments).version or None)
    except ReleaseError as error:
        print(f"release: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
