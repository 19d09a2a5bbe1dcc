#!/usr/bin/env bash
# Runs a command with ROS 2 and the built workspace.
set -e
source /opt/ros/jazzy/setup.bash
source /ws/install/setup.bash
exec "$@"
