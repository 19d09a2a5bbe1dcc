"""The networks: torch only. `create` builds one by name, `archive` reads and writes their weights."""

from radcam_depth_ros.networks.baff.baseline import Baseline
from radcam_depth_ros.networks.baff.network import Baff, BaffConfig
from radcam_depth_ros.networks.baff_paper.network import BaffPaper, BaffPaperConfig
from radcam_depth_ros.networks.cafnet import Cafnet, CafnetConfig, CafnetOutputs
from radcam_depth_ros.networks.config import ArchitectureError, NetworkConfig
from radcam_depth_ros.networks.distillation import DistillationFeatures
from radcam_depth_ros.networks.interface import RADAR_COLUMNS, Association, Candidates, Depths, Network, TrainOutputs
from radcam_depth_ros.networks.lircdepth import Lircdepth, LircdepthConfig, LircdepthOutputs
from radcam_depth_ros.networks.registry import create, names
from radcam_depth_ros.networks.structured import Structured, StructuredConfig, StructuredOutputs

__all__ = [
    "RADAR_COLUMNS",
    "ArchitectureError",
    "Association",
    "Baff",
    "BaffConfig",
    "BaffPaper",
    "BaffPaperConfig",
    "Baseline",
    "Cafnet",
    "CafnetConfig",
    "CafnetOutputs",
    "Candidates",
    "Depths",
    "DistillationFeatures",
    "Lircdepth",
    "LircdepthConfig",
    "LircdepthOutputs",
    "Network",
    "NetworkConfig",
    "Structured",
    "StructuredConfig",
    "StructuredOutputs",
    "TrainOutputs",
    "create",
    "names",
]
