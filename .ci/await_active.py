"""Waits until a lifecycle node is active: `python await_active.py /name SECONDS`; exit code 1 when it takes longer."""

from __future__ import annotations

import sys
import time

import rclpy
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState


def main(name: str, limit_s: float) -> int:
    """Asks until the answer is `active`, and says what it was in the end."""
    rclpy.init()
    node = rclpy.create_node("await_active")
    client = node.create_client(GetState, f"{name}/get_state")
    deadline_s, state = time.monotonic() + limit_s, State(label="not there")
    while state.id != State.PRIMARY_STATE_ACTIVE and time.monotonic() < deadline_s:
        if client.wait_for_service(timeout_sec=1.0):
            future = client.call_async(GetState.Request())
            rclpy.spin_until_future_complete(node, future, timeout_sec=2.0)
            state = future.result().current_state if future.done() else state
    print(f"{name} is {state.label}")
    return 0 if state.id == State.PRIMARY_STATE_ACTIVE else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], float(sys.argv[2])))
