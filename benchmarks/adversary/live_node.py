"""The live node as a process, which writes how long its longest callbacks took.

python -m benchmarks.adversary.live_node FILE --ros-args --params-file PARAMETERS
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

from rclpy.executors import SingleThreadedExecutor

from radcam_depth_ros.node import main


def time_callbacks(file: Path) -> None:
    """Has the executor of this process write its longest callbacks to a file: milliseconds by what was called."""
    wait: Any = SingleThreadedExecutor.wait_for_ready_callbacks
    longest_ms: dict[str, float] = {}
    running: list[tuple[str, float]] = []

    def timed(executor: Any, *arguments: Any, **named: Any) -> Any:
        # Between two calls of it, the executor runs the callback that the first one gave.
        while running:
            name, since_s = running.pop()
            took_ms = 1e3 * (time.monotonic() - since_s)
            if took_ms > longest_ms.get(name, 0.0):
                longest_ms[name] = took_ms
                file.write_text(json.dumps(longest_ms), encoding="utf-8")
        found: Any = wait(executor, *arguments, **named)
        running.append((_name(found[1]), time.monotonic()))
        return found

    class_: Any = SingleThreadedExecutor
    class_.wait_for_ready_callbacks = timed


def end_with_parent() -> None:
    """Ends this process when the one that started it is gone, however that ended."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _name(entity: Any) -> str:
    """Loading a network takes long, so transitions count apart."""
    if getattr(entity, "srv_name", "").endswith("change_state"):
        return "transitions"
    return "all others"


if __name__ == "__main__":
    end_with_parent()
    time_callbacks(Path(sys.argv[1]))
    main(sys.argv[:1] + sys.argv[2:])
