"""A tiny network with sections."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import MappingProxyType

import pytest
import torch
from torch import Tensor, nn

from radcam_depth_ros.networks import Depths, Network, registry


@dataclass(frozen=True)
class TinyConfig:
    """Architecture of the tiny network."""

    width: int = 8
    has_tail: bool = True
    min_depth_m: float = 1.0
    max_depth_m: float = 100.0
    focal_length_px: float = 630.0


class Tiny(Network):
    """A convolution and its norm, attention over a quarter of the size, and a head."""

    config_type = TinyConfig
    sections = (("encoder", "encoder"), ("attention", "attention"), ("heads", "head"), ("heads", "tail.0"))
    paper = MappingProxyType({"width": 16})

    def __init__(self, config: TinyConfig) -> None:
        super().__init__(config)
        width = config.width
        self.encoder = nn.Sequential(nn.Conv2d(3, width, 3, padding=1), nn.BatchNorm2d(width), nn.ReLU())
        self.attention = TinyAttention()
        self.head = nn.Conv2d(width, 1, 1)
        self.tail = nn.ModuleList([nn.Conv2d(1, 1, 1)] if config.has_tail else [])

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        x = self.attention(self.encoder(image))
        x = self.head(x)
        for layer in self.tail:
            x = layer(x)
        dense = 1.0 + torch.sigmoid(x.float())
        return Depths(dense, torch.full_like(dense, float("nan")), dense)


class TinyAttention(nn.Module):
    """Exact attention over the pixels of a pooled map."""

    def forward(self, x: Tensor) -> Tensor:
        small = nn.functional.avg_pool2d(x, 16)
        tokens = small.flatten(2).transpose(1, 2).unsqueeze(1).contiguous()
        attended = nn.functional.scaled_dot_product_attention(tokens, tokens, tokens)
        attended = attended.squeeze(1).transpose(1, 2).reshape(small.shape)
        return x + nn.functional.interpolate(attended, size=(x.shape[2], x.shape[3]), mode="nearest")


@pytest.fixture
def tiny() -> Iterator[str]:
    """Name of a registered tiny network, without weights."""
    registry.register("tiny")(Tiny)
    yield "tiny"
    del registry._NETWORKS["tiny"]
