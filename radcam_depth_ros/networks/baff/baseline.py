"""`baseline`: two stages without attention, as RadarNet and FusionNet, which the papers compare with."""

from dataclasses import dataclass
from types import MappingProxyType

from radcam_depth_ros.networks.baff.network import Baff, BaffConfig
from radcam_depth_ros.networks.registry import register


@dataclass(frozen=True)
class BaselineConfig(BaffConfig):
    """Architecture of `baseline`: that of `baff` without BF, CA and PA."""

    bidirectional: bool = False
    channel_attention: bool = False
    position_attention: bool = False


@register("baseline")
class Baseline(Baff):
    """`baff` without its bottom-up branch and attention, under a name of its own."""

    about = "baff without its bottom-up branch and attention"
    config_type = BaselineConfig
    trained_like = "baff"
    paper = MappingProxyType({"bidirectional": False, "channel_attention": False, "position_attention": False})
