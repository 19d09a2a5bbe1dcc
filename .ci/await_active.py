"""Waits until a lifecycle node says that it is active: `python await_active.py /name`."""

from __future__ import annotations

import sys

import rclpy
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState


def main() -> None:
    """Asks until the answer is `active`; whoever calls sets the time limit."""
    rclpy.init()
    node = rclpy.create_node("await_active")
    client = node.create_client(GetState, f"{sys.argv[1]}/get_state")
    state = None
    while state != State.PRIMARY_STATE_ACTIVE:
        if not client.wait_for_service(timeout_sec=1.0):
            continue
        future = client.call_async(GetState.Request())
        rclpy.spin_until_future_complete(node, future, timeout_sec=2.0)
        state = future.result().current_state.id if future.done() else None
    print(f"{sys.argv[1]} is active")


if __name__ == "__main__":
    main()
