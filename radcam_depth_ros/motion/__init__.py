"""Motion of the vehicle from odometry or /tf, and compensation of radar returns for it."""

from radcam_depth_ros.motion.links import Memory
from radcam_depth_ros.motion.mounts import Mounts
from radcam_depth_ros.motion.own_motion import OwnMotion, own_motion
from radcam_depth_ros.motion.poses import Poses, interpolate
from radcam_depth_ros.motion.returns import MOVING_MPS, Displacement, displacement, move
from radcam_depth_ros.motion.vehicle import Motion, MotionError, moves

__all__ = [
    "MOVING_MPS",
    "Displacement",
    "Memory",
    "Motion",
    "MotionError",
    "Mounts",
    "OwnMotion",
    "Poses",
    "displacement",
    "interpolate",
    "move",
    "moves",
    "own_motion",
]
