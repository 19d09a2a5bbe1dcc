"""MobileNetV2 ([Sandler2018]) without its classifier, with the parameter names of torchvision's checkpoints."""

import torch
from torch import Tensor, nn

from radcam_depth_ros.networks.layers.blocks import reduced

SETTINGS = ((1, 16, 1, 1), (6, 24, 2, 2), (6, 32, 3, 2), (6, 64, 4, 2), (6, 96, 3, 1), (6, 160, 3, 2), (6, 320, 1, 1))
"""Of each group of blocks: how much wider they are inside, channels, how many, stride of the first; table 2."""


class ConvNormRelu(nn.Sequential):
    """Convolution, batch norm, ReLU6."""

    def __init__(self, in_channels: int, out_channels: int, kernel: int = 3, stride: int = 1, groups: int = 1) -> None:
        super().__init__(
            nn.Conv2d(in_channels, out_channels, kernel, stride, kernel // 2, groups=groups, bias=False),
            nn.BatchNorm2d(out_channels),
            nn.ReLU6(inplace=True),
        )


class InvertedResidual(nn.Module):
    """A narrow map, widened, filtered channel by channel, narrowed; added to the input where sizes are the same."""

    def __init__(self, in_channels: int, out_channels: int, stride: int, widening: int) -> None:
        super().__init__()
        inside = in_channels * widening
        layers: list[nn.Module] = [ConvNormRelu(in_channels, inside, kernel=1)] if widening != 1 else []
        layers += [
            ConvNormRelu(inside, inside, stride=stride, groups=inside),
            nn.Conv2d(inside, out_channels, 1, bias=False),
            nn.BatchNorm2d(out_channels),
        ]
        self.conv = nn.Sequential(*layers)
        self.adds = stride == 1 and in_channels == out_channels

    def forward(self, x: Tensor) -> Tensor:
        result: Tensor = self.conv(x)
        return result + x if self.adds else result


class MobileNetV2(nn.Module):
    """The blocks of MobileNetV2.

    Args:
        in_channels: Of the input.

    Attributes:
        checkpoint: torchvision's name of the checkpoint that fits.
        left_out: What the names of entries begin with that a checkpoint may have besides.
    """

    checkpoint = "mobilenet_v2"
    left_out = ("features.", "classifier.")

    def __init__(self, in_channels: int = 3) -> None:
        super().__init__()
        layers: list[nn.Module] = [ConvNormRelu(in_channels, 32, stride=2)]
        channels = 32
        for widening, width, count, stride in SETTINGS:
            for index in range(count):
                layers.append(InvertedResidual(channels, width, stride if index == 0 else 1, widening))
                channels = width
        self.features = nn.Sequential(*layers)


class ContextEncoder(MobileNetV2):
    """ImageNet's features of the image at half its size: at 1/8, 1/16, 1/32 and 1/64 of it, see `CHANNELS`.

    At the full size they would cost twice what all of `baff`'s encoder does; what a thing is shows at half of it. It
    keeps float32: in bfloat16 its narrow layers are most of what separates the depths of two formats.
    """

    CHANNELS = (24, 32, 96, 320)
    mean: Tensor
    deviation: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("mean", torch.tensor([0.485, 0.456, 0.406]).reshape(1, 3, 1, 1), persistent=False)
        self.register_buffer("deviation", torch.tensor([0.229, 0.224, 0.225]).reshape(1, 3, 1, 1), persistent=False)
        for module in self.modules():
            module.keeps_float32 = True  # type: ignore[assignment]  # a flag that `convert` looks for

    def forward(self, image: Tensor) -> list[Tensor]:
        """Takes (B, 3, H, W), 0 to 1, H and W multiples of 32, to four maps, finest first; sizes are rounded up."""
        x = (reduced(image, 2) - self.mean) / self.deviation
        maps: list[Tensor] = []
        for index, layer in enumerate(self.features):
            x = layer(x)
            # The last of the groups with 24, 32, 96 and 320 channels.
            if index == 3 or index == 6 or index == 13 or index == 17:
                maps.append(x)
        return maps


class PyramidEncoder(MobileNetV2):
    """All of MobileNetV2: maps at 1/2, 1/4, 1/8, 1/16, 1/32.

    Args:
        in_channels: Of the input; with 3 the names and shapes are those of torchvision's checkpoints.
    """

    CHANNELS = (16, 24, 32, 64, 1280)

    def __init__(self, in_channels: int = 3) -> None:
        super().__init__(in_channels=in_channels)
        self.features.append(ConvNormRelu(SETTINGS[-1][1], self.CHANNELS[-1], kernel=1))

    def forward(self, x: Tensor) -> list[Tensor]:
        """Takes (B, in_channels, H, W) to five maps, finest first; an image must be normalised before."""
        maps: list[Tensor] = []
        for index, layer in enumerate(self.features):
            x = layer(x)
            # The last of the groups with 16, 24, 32 and 64 channels, and the last of all.
            if index == 1 or index == 3 or index == 6 or index == 10 or index == 18:
                maps.append(x)
        return maps
