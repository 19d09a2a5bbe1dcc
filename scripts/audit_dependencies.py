"""Looks for known vulnerabilities in what is installed, with pip-audit; without its data it says when it last had some.

`make lint` runs it; `--record` notes the date of an audit that found nothing, in scripts/last_audit.
"""

from __future__ import annotations

import argparse
import datetime
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
RECORD = Path(__file__).with_name("last_audit")
PROBE = "numpy=="  # audited alone first: without data, all others are not asked for one by one


def audited(*options: str, limit_s: float) -> list[dict[str, Any]]:
    """The packages that pip-audit has data for, with their `vulns`; none where it reaches no data.

    pip-audit ends with 0 for packages that it does not find, so its exit code says nothing.
    """
    command = [sys.executable, "-m", "pip_audit", "--format", "json", "--progress-spinner", "off", "--timeout", "5"]
    try:
        done = subprocess.run([*command, *options], capture_output=True, text=True, timeout=limit_s, check=False)
        packages: list[dict[str, Any]] = json.loads(done.stdout)["dependencies"]
    except (subprocess.TimeoutExpired, ValueError, KeyError):
        return []
    return [package for package in packages if "skip_reason" not in package]


def findings(packages: list[dict[str, Any]]) -> list[str]:
    """A line for each known vulnerability."""
    return [
        f"{package['name']} {package['version']}: {found['id']}, mended in {', '.join(found['fix_versions']) or 'none'}"
        for package in packages
        for found in package["vulns"]
    ]


def main(arguments: list[str]) -> int:
    """Prints one line, or a line for each vulnerability; 1 where there are some."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--record", action="store_true", help="note the date of an audit that found nothing")
    record = parser.parse_args(arguments).record
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    packages: list[dict[str, Any]] = []
    with tempfile.NamedTemporaryFile("w", suffix=".txt", encoding="utf-8") as probe:
        probe.writelines(f"{pin}\n" for pin in pins if pin.startswith(PROBE))
        probe.flush()
        if audited("--requirement", probe.name, "--no-deps", "--disable-pip", limit_s=20.0):
            packages = audited("--local", "--skip-editable", limit_s=60.0)
    if not packages:
        last = RECORD.read_text(encoding="utf-8").strip() if RECORD.exists() else "never"
        print(f"dependencies: no data on vulnerabilities reachable: skipped, last checked: {last}")
        return 0
    lines = findings(packages)
    for line in lines:
        print(f"dependencies: {line}")
    if not lines:
        print(f"dependencies: no known vulnerability in {len(packages)} packages")
        if record:
            RECORD.write_text(f"{datetime.date.today().isoformat()}\n", encoding="utf-8")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
