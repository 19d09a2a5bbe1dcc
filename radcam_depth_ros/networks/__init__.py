"""The networks: torch only. `create` builds one by name, `weights_io.archive` reads and writes their weights."""

import importlib

from radcam_depth_ros.networks.config import ArchitectureError, NetworkConfig
from radcam_depth_ros.networks.distillation import DistillationFeatures
from radcam_depth_ros.networks.interface import RADAR_COLUMNS, Association, Candidates, Depths, Network, TrainOutputs
from radcam_depth_ros.networks.registry import create, names

__all__ = [
    "RADAR_COLUMNS",
    "ArchitectureError",
    "Association",
    "Candidates",
    "Depths",
    "DistillationFeatures",
    "Network",
    "NetworkConfig",
    "TrainOutputs",
    "create",
    "names",
]

# Modules that register a network each; CONTRIBUTING.md says what else a new one needs.
for _module in (
    "baff.baseline",
    "baff.network",
    "baff_paper.network",
    "cafnet",
    "lircdepth",
    "structured",
):
    importlib.import_module(f"{__name__}.{_module}")
