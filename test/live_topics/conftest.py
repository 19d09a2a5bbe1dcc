"""Skipped where there is no ROS."""

import pytest

pytest.importorskip("rclpy")
