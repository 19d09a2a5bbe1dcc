"""The live ROS 2 node: lifecycle, quality of service, back-pressure, diagnostics, publishing."""

from __future__ import annotations

from radcam_depth_ros.node.process import main

__all__ = ["main"]
