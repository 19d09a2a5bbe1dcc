from __future__ import annotations

import json
import runpy
import subprocess
from pathlib import Path
from typing import Any

import pytest

SCRIPT = str(Path(__file__).parents[1] / "scripts" / "audit_dependencies.py")
SKIPPED = {"name": "numpy", "skip_reason": "Dependency not found on PyPI and could not be audited"}
CLEAN = {"name": "numpy", "version": "2.4.6", "vulns": []}
FOUND = {"name": "torch", "version": "1.0", "vulns": [{"id": "CVE-1", "fix_versions": ["2.0"]}]}


@pytest.mark.parametrize(
    ("packages", "code", "said"),
    [
        ([SKIPPED], 0, "no data on vulnerabilities reachable: skipped, last checked: never"),
        (None, 0, "no data on vulnerabilities reachable"),
        ([CLEAN, SKIPPED], 0, "no known vulnerability in 1 packages"),
        ([CLEAN, FOUND], 1, "torch 1.0: CVE-1, mended in 2.0"),
    ],
)
def test_the_audit_says_what_it_found_and_whether_it_could_look(packages, code, said, monkeypatch, tmp_path, capsys):
    def answer(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        text = "" if packages is None else json.dumps({"dependencies": packages})
        return subprocess.CompletedProcess(command, 0, text, "")

    monkeypatch.setattr(subprocess, "run", answer)
    script = runpy.run_path(SCRIPT)
    settings = script["main"].__globals__
    settings["RECORD"], settings["ROOT"] = tmp_path / "last_audit", tmp_path
    (tmp_path / "constraints.txt").write_text("numpy==2.4.6\n")
    assert script["main"](["--record"]) == code
    assert said in capsys.readouterr().out
    assert (tmp_path / "last_audit").exists() == ("no known" in said)


def test_an_audit_that_hangs_is_one_without_data(monkeypatch):
    def hang(command: list[str], **_: Any) -> None:
        raise subprocess.TimeoutExpired(command, 60)

    monkeypatch.setattr(subprocess, "run", hang)
    assert runpy.run_path(SCRIPT)["audited"](limit_s=1.0) == []
