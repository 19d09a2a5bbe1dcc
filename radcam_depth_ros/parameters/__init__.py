"""The node's parameters: the same dataclasses that everything else is configured by, with descriptions and ranges.

A parameter has the default of the field that it sets. Files of them are read as the node reads them, without ROS.
"""

from __future__ import annotations

from radcam_depth_ros.parameters.assembly import build_config
from radcam_depth_ros.parameters.config import NodeConfig, ParameterError
from radcam_depth_ros.parameters.file import NODE_NAME, ParameterFile, read_parameter_file
from radcam_depth_ros.parameters.spec import ParameterKind, ParameterSpec
from radcam_depth_ros.parameters.table import PARAMETERS, RENAMED, SECTIONS

__all__ = [
    "NODE_NAME",
    "PARAMETERS",
    "RENAMED",
    "SECTIONS",
    "NodeConfig",
    "ParameterError",
    "ParameterFile",
    "ParameterKind",
    "ParameterSpec",
    "build_config",
    "read_parameter_file",
]
