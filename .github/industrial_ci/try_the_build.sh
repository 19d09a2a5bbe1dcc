#!/usr/bin/env bash
# The built package beside ROS from apt: the node becomes active and ends, and tests of messages and node pass.
set -euo pipefail

checkout=$PWD
export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_LOG_DIR=/tmp/ros_log
cd /tmp # so that nothing comes from the checkout
python3 -c 'import radcam_depth_ros as r; print(r.__file__)' | grep /install/
ros2 run radcam_depth_ros radcam-depth --help >/dev/null
# Not by `ros2 run`: the signal is for the node itself.
"$(ros2 pkg prefix radcam_depth_ros)/lib/radcam_depth_ros/radcam_depth_node" &
node_pid=$!
python3 "$checkout/.ci/await_active.py" /radcam_depth 240
kill -INT "$node_pid"
wait "$node_pid"

cp -r "$checkout" /tmp/checkout # tests write beside themselves
cd /tmp/checkout
python3 -m pytest -q -m "not slow and not alone and not exhaustive and not endurance" test/messages test/node test/test_package.py
