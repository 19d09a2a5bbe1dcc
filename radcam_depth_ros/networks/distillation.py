"""Holds the feature maps that distillation compares between two networks."""

from typing import NamedTuple

from torch import Tensor


class DistillationFeatures(NamedTuple):
    """Maps within a network, as teacher or as student.

    A network whose `train_outputs` have this as their field `features` can teach, and learn from, any other whose maps
    have the same number of channels and sizes; those of `decoder` may differ in their channels.

    image: Of the image's encoder, (B, C, h, w) at 1/2, 1/4, 1/8, 1/16, 1/32 of the image's size.
    radar: The same of the radar's encoder, as they join the image's.
    decoder: In the order of decoding, at 1/16, 1/8, 1/4, 1/2, 1.
    inter_depth_m: (B, 1, H, W) float32 metres, as decided at 1/8, 1/4, 1/2.
    """

    image: list[Tensor]
    radar: list[Tensor]
    decoder: list[Tensor]
    inter_depth_m: list[Tensor]
