"""The node as a process of its own: it ends promptly and cleanly, whatever it is busy with."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
NAP_S = 60
"""So long the node is busy, see `sleeping_node`; by itself it ends within 1.2 s, where a processor is free."""


def end(process: subprocess.Popen[str], number: signal.Signals = signal.SIGINT, times: int = 1) -> str:
    """Sends a signal; the process must end with 0, before what it is busy with. Returns what it wrote to stderr."""
    process.send_signal(number)
    for _ in range(times - 1):
        time.sleep(0.2)
        process.send_signal(number)
    _, errors = process.communicate(timeout=NAP_S / 2)
    assert process.returncode == 0, errors
    assert "Traceback" not in errors
    return errors


def test_a_node_that_waits_ends_at_a_signal(run: Callable[..., Any], peer: Any) -> None:
    process = run("never")
    peer.until(lambda: peer.status("model", "a sleeper"))
    end(process)


def test_a_node_that_loads_its_network_ends_at_a_signal(run: Callable[..., Any]) -> None:
    process = run("configure")
    assert process.stdout.readline() == "busy\n"
    end(process)


def test_a_node_in_the_middle_of_an_image_ends_at_a_signal(run: Callable[..., Any], peer: Any) -> None:
    process = run("inference")
    peer.connect()
    peer.send_until(lambda: peer.status("camera", "Hz on /image"))
    assert process.stdout.readline() == "busy\n"
    end(process)


def test_a_node_in_the_middle_of_its_shutdown_ends_at_signals(run: Callable[..., Any], peer: Any) -> None:
    from lifecycle_msgs.srv import ChangeState

    process = run("inference")
    client = peer.peer.create_client(ChangeState, "/radcam_depth/change_state")
    peer.connect()
    peer.send_until(lambda: peer.status("camera", "Hz on /image"))
    assert process.stdout.readline() == "busy\n"
    peer.until(client.service_is_ready, what="the service")
    request = ChangeState.Request()
    request.transition.label = "shutdown"
    client.call_async(request)
    peer.until(lambda: not peer.peer.count_subscribers("image"), what="the wait for the network")
    end(process, times=2)


def test_a_transition_that_is_not_possible_does_not_end_the_node(run: Callable[..., Any], peer: Any) -> None:
    from lifecycle_msgs.srv import ChangeState

    process = run("never", "-p", "autostart:=false")
    client = peer.peer.create_client(ChangeState, "/radcam_depth/change_state")
    peer.until(client.service_is_ready, what="the service")
    request = ChangeState.Request()
    request.transition.id = 3  # activate, which an unconfigured node cannot
    future = client.call_async(request)
    peer.until(future.done, what="an answer")
    assert not future.result().success
    peer.diagnostics.clear()
    peer.until(lambda: peer.status("model", "the node is unconfigured"), what="diagnostics")
    end(process, signal.SIGTERM)


def test_a_parameter_file_that_cannot_be_read_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "node.yaml"
    path.write_text("radcam_depth: [", encoding="utf-8")
    start = f"from radcam_depth_ros.node import main; main(['--ros-args', '--params-file', {str(path)!r}])"
    process = subprocess.run([sys.executable, "-c", start], cwd=ROOT, capture_output=True, text=True, check=False)
    assert process.returncode == 2
    assert "Traceback" not in process.stderr
    assert process.stderr.splitlines()[-1].startswith("radcam_depth_node: ")
    assert str(path) in process.stderr.splitlines()[-1]
