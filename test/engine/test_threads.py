from __future__ import annotations

import threading

import pytest

from radcam_depth_ros.engine import EngineError, apart


def test_it_runs_in_a_thread_that_has_ended_after() -> None:
    thread = apart(threading.current_thread)
    assert thread is not threading.current_thread()
    assert not thread.is_alive()


def test_errors_are_the_callers() -> None:
    def fail() -> None:
        raise EngineError("expected a device, got none")

    with pytest.raises(EngineError, match="got none"):
        apart(fail)
