"""Runs the node as a process: start, signals, a prompt and clean end."""

from __future__ import annotations

import os
import signal
import sys
import threading
from typing import TYPE_CHECKING, NoReturn

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from radcam_depth_ros import openmp

if TYPE_CHECKING:
    from radcam_depth_ros.node.depth_node import RadcamDepthNode

GRACE_S = 1.2
"""So long after a signal the process waits for its threads, whatever the network is busy with."""


class _Life(threading.Thread):
    """Everything of ROS, in a thread of its own, so that the main thread answers signals while a network loads."""

    def __init__(self, args: list[str] | None, stop: threading.Event) -> None:
        super().__init__(name="ros", daemon=True)
        self._args = args
        self._stop_asked = stop
        self.error: BaseException | None = None

    def run(self) -> None:
        try:
            # Signals are the main thread's: rclpy's own handlers would end the context under the worker's feet.
            rclpy.init(args=self._args, signal_handler_options=SignalHandlerOptions.NO)
            try:
                self._spin()
            finally:
                rclpy.try_shutdown()
        except BaseException as error:  # told by the main thread
            self.error = error
        finally:
            self._stop_asked.set()

    def _spin(self) -> None:
        # Here, since it takes seconds to import torch, in which signals are to be answered.
        from radcam_depth_ros.node.depth_node import RadcamDepthNode

        node = RadcamDepthNode()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        try:
            while not self._stop_asked.is_set():
                _spin_once(executor, node)
        finally:
            node.close(timeout_s=GRACE_S / 2)
            executor.remove_node(node)
            node.destroy_node()


def _spin_once(executor: SingleThreadedExecutor, node: RadcamDepthNode) -> None:
    try:
        executor.spin_once(timeout_sec=0.2)
    except Exception as error:  # rclpy's own: callbacks and services handle theirs
        node.report_defect(error)


def main(args: list[str] | None = None) -> NoReturn:
    """Runs the node until SIGINT or SIGTERM, then ends the process: with 0, or 2 when the node could not start.

    Args:
        args: The command line; the process's own by default.
    """
    openmp.prepare()
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    life = _Life(args, stop)
    life.start()
    stop.wait()
    life.join(GRACE_S)
    if life.error is not None:
        reason = " ".join(str(life.error).split())
        print(f"radcam_depth_node: {reason or type(life.error).__name__}", file=sys.stderr)
    sys.stdout.flush()
    sys.stderr.flush()
    # Not sys.exit: a network that is loading or in the middle of an image can't be interrupted, and Python going down
    # around it can crash. It would also take seconds to unload torch on a busy machine, with nothing left to be done.
    os._exit(0 if life.error is None else 2)
