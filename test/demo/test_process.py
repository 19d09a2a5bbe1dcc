from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from demo import process as process_module
from demo.process import DemoError, NodeProcess


@pytest.fixture
def run(tmp_path: Path) -> Callable[[str], NodeProcess]:
    def make(program: str) -> NodeProcess:
        command = (sys.executable, "-u", "-c", program)
        return NodeProcess(tmp_path / "node.yaml", tmp_path / "node.log", command)

    return make


def until_over(process: NodeProcess) -> None:
    for _ in range(500):
        process.check()
        time.sleep(0.02)


def test_a_node_that_ends_is_an_error_with_the_end_of_its_log(run: Callable[[str], NodeProcess]) -> None:
    with (
        run("print('what it said'); raise SystemExit(3)") as process,
        pytest.raises(DemoError, match=r"(?s)exit code 3.*what it said"),
    ):
        until_over(process)


def test_a_node_that_runs_is_ended_by_sigint(
    run: Callable[[str], NodeProcess], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process_module, "GRACE_S", 100.0)  # however slow the machine is
    # A shell that starts jobs in the background has them ignore SIGINT.
    program = """
import signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    print("up")
    time.sleep(60)
except KeyboardInterrupt:
    print("interrupted")
"""
    with run(program) as process:
        while process.last_lines != "up":
            process.check()
            time.sleep(0.02)
    assert process.last_lines == "up\ninterrupted"


def test_the_first_error_is_found_in_the_log(run: Callable[[str], NodeProcess]) -> None:
    with run("print('[INFO] fine'); print('[ERROR] [1.0] [node]: no'); import time; time.sleep(60)") as process:
        assert process.problem is None or process.problem.startswith("[ERROR]")
        while process.problem is None:
            time.sleep(0.02)
        assert process.problem == "[ERROR] [1.0] [node]: no"
