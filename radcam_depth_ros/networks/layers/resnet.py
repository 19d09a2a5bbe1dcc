"""ResNet-18 and ResNet-34 ([He2016]) without their classifier, with the parameter names of torchvision's."""

import torch
from torch import Tensor, nn

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_DEVIATION = (0.229, 0.224, 0.225)
RESNET_18 = (2, 2, 2, 2)
RESNET_34 = (3, 4, 6, 3)
"""Blocks at 1/4, 1/8, 1/16, 1/32."""

CHANNELS = (64, 64, 128, 256, 512)
"""Of the maps at 1/2, 1/4, 1/8, 1/16, 1/32."""


class BasicBlock(nn.Module):
    """Two 3x3 convolutions and a shortcut."""

    def __init__(self, in_channels: int, out_channels: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(in_channels, out_channels, 3, stride, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(out_channels)
        self.relu = nn.ReLU(inplace=True)
        self.conv2 = nn.Conv2d(out_channels, out_channels, 3, 1, 1, bias=False)
        self.bn2 = nn.BatchNorm2d(out_channels)
        self.downsample: nn.Module = nn.Identity()
        if stride != 1 or in_channels != out_channels:
            self.downsample = nn.Sequential(
                nn.Conv2d(in_channels, out_channels, 1, stride, bias=False), nn.BatchNorm2d(out_channels)
            )

    def forward(self, x: Tensor) -> Tensor:
        inside = self.bn2(self.conv2(self.relu(self.bn1(self.conv1(x)))))
        result: Tensor = self.relu(inside + self.downsample(x))
        return result


class Levels(nn.Module):
    """The four levels of residual blocks, `layer1` to `layer4`, from maps at 1/2 on.

    Args:
        blocks: Of each level.
        channels: Of the input and of each level.
    """

    def __init__(self, blocks: tuple[int, ...], channels: tuple[int, ...] = CHANNELS) -> None:
        super().__init__()
        self.maxpool = nn.MaxPool2d(3, 2, 1)
        self.layer1 = _level(channels[0], channels[1], blocks[0], 1)
        self.layer2 = _level(channels[1], channels[2], blocks[1], 2)
        self.layer3 = _level(channels[2], channels[3], blocks[2], 2)
        self.layer4 = _level(channels[3], channels[4], blocks[3], 2)

    def levels(self, x: Tensor) -> list[Tensor]:
        """Takes the map at 1/2 to itself and those at 1/4, 1/8, 1/16, 1/32."""
        maps = [x, self.layer1(self.maxpool(x))]
        maps.append(self.layer2(maps[1]))
        maps.append(self.layer3(maps[2]))
        maps.append(self.layer4(maps[3]))
        return maps

    def forward(self, x: Tensor) -> list[Tensor]:
        return self.levels(x)


class ResNet(Levels):
    """An image's maps at 1/2, 1/4, 1/8, 1/16, 1/32; images are 0 to 1, as everywhere.

    Args:
        blocks: `RESNET_18` or `RESNET_34`.

    Attributes:
        checkpoint: torchvision's name of the checkpoint that fits.
        left_out: What the names of entries begin with that a checkpoint may have besides.
    """

    left_out = ("fc.",)
    mean: Tensor
    deviation: Tensor

    def __init__(self, blocks: tuple[int, ...]) -> None:
        super().__init__(blocks)
        self.checkpoint = f"resnet{2 * sum(blocks) + 2}"
        self.conv1 = nn.Conv2d(3, CHANNELS[0], 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(CHANNELS[0])
        self.relu = nn.ReLU(inplace=True)
        self.register_buffer("mean", torch.tensor(IMAGENET_MEAN).reshape(1, 3, 1, 1), persistent=False)
        self.register_buffer("deviation", torch.tensor(IMAGENET_DEVIATION).reshape(1, 3, 1, 1), persistent=False)

    def forward(self, x: Tensor) -> list[Tensor]:
        """Takes (B, 3, H, W) to maps of `CHANNELS` channels."""
        return self.levels(self.relu(self.bn1(self.conv1((x - self.mean) / self.deviation))))


def _level(in_channels: int, out_channels: int, blocks: int, stride: int) -> nn.Sequential:
    others = (BasicBlock(out_channels, out_channels, 1) for _ in range(blocks - 1))
    return nn.Sequential(BasicBlock(in_channels, out_channels, stride), *others)
