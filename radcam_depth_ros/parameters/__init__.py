"""ROS parameters: the same dataclasses that everything else is configured by, with descriptions and ranges.

A parameter has the default of the field that it sets.
"""

from __future__ import annotations

from radcam_depth_ros.parameters.assembly import build_config
from radcam_depth_ros.parameters.config import IMAGE_TRANSPORTS, NodeConfig, ParameterError
from radcam_depth_ros.parameters.declared import Parameters
from radcam_depth_ros.parameters.spec import ParameterSpec
from radcam_depth_ros.parameters.table import PARAMETERS

__all__ = [
    "IMAGE_TRANSPORTS",
    "PARAMETERS",
    "NodeConfig",
    "ParameterError",
    "ParameterSpec",
    "Parameters",
    "build_config",
]
