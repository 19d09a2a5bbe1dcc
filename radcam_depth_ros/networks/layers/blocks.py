"""Blocks that the networks share: convolutions, encoders, up-sampling."""

import torch
from torch import Tensor, nn
from torch.jit import is_scripting  # type: ignore[attr-defined]  # torch does not name it among its exports
from torch.nn import functional

from radcam_depth_ros.networks.layers.number_formats import InFloat32, RawConv2d

LEAK = 0.2  # The slope of the public implementation of [Singh2023]; [Electronics2025] names none.


class InstanceNorm(nn.GroupNorm):
    """Instance norm: by each image's own mean and variance ([Ulyanov2016]), in float32.

    A single image in evaluation gets statistics that are the same to the digit for any number of threads, so that a
    node that takes fewer threads beside other work gives the same depth: the mean of a channel is one thread's, while
    torch's kernels for this norm sum up a part of the pixels in each thread.
    """

    keeps_float32 = True

    def __init__(self, channels: int) -> None:
        super().__init__(channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        # A batch norm of each image: its gradient is much faster than a group norm's, above all in bfloat16.
        # TorchScript does not compile what stands below `is_scripting`.
        if not is_scripting():  # noqa: SIM102
            if self.training:
                return torch.cat([self._of_one(image) for image in torch.split(x, 1)])
        # No gradient passes through statistics that are given.
        if self.training or x.shape[0] != 1 or torch.is_grad_enabled():
            return functional.group_norm(x, self.num_groups, self.weight, self.bias, self.eps)
        values = x.float()
        mean = values.mean(dim=(2, 3))[0]
        # Of a channel that is all but constant, rounding may leave less than nothing, whose root is NaN.
        variance = ((values * values).mean(dim=(2, 3))[0] - mean * mean).clamp_min(0.0)
        return functional.batch_norm(x, mean, variance, self.weight, self.bias, False, 0.0, self.eps)

    @torch.jit.unused
    def _of_one(self, image: Tensor) -> Tensor:
        """(1, C, H, W), normalised by its own statistics, in the layout that it has."""
        return functional.batch_norm(image, None, None, self.weight, self.bias, True, 0.0, self.eps)


def norm(channels: int, instance: bool) -> nn.Module:
    """Batch norm; or instance norm, by each image's own mean and variance."""
    return InstanceNorm(channels) if instance else nn.BatchNorm2d(channels)


class ConvBlock(nn.Sequential):
    """Convolution, norm, leaky ReLU; `stride` divides the size; `raw` for a map of raw values, see `RawConv2d`."""

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        kernel: int = 3,
        stride: int = 1,
        instance: bool = False,
        raw: bool = False,
    ) -> None:
        convolution = RawConv2d if raw else nn.Conv2d
        super().__init__(
            convolution(in_channels, out_channels, kernel, stride, kernel // 2, bias=False),
            norm(out_channels, instance),
            nn.LeakyReLU(LEAK, inplace=True),
        )


class Projection(nn.Sequential):
    """Convolution and norm, 1x1 unless told otherwise; `raw` as for `ConvBlock`."""

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        kernel: int = 1,
        stride: int = 1,
        instance: bool = False,
        raw: bool = False,
    ) -> None:
        convolution = RawConv2d if raw else nn.Conv2d
        super().__init__(
            convolution(in_channels, out_channels, kernel, stride, kernel // 2, bias=False),
            norm(out_channels, instance),
        )


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions and a shortcut ([He2016], basic block)."""

    def __init__(self, in_channels: int, out_channels: int, stride: int = 1, instance: bool = False) -> None:
        super().__init__()
        self.first = ConvBlock(in_channels, out_channels, stride=stride, instance=instance)
        self.second = Projection(out_channels, out_channels, 3, instance=instance)
        self.shortcut: nn.Module = nn.Identity()
        if stride != 1 or in_channels != out_channels:
            self.shortcut = Projection(in_channels, out_channels, stride=stride, instance=instance)
        self.activation = nn.LeakyReLU(LEAK, inplace=True)

    def forward(self, x: Tensor) -> Tensor:
        result: Tensor = self.activation(self.second(self.first(x)).add_(self.shortcut(x)))
        return result


class ResidualEncoder(nn.Module):
    """ResNet-18 style encoder: 7x7 stride 2, max pool, two residual blocks a level.

    Args:
        in_channels: Planes of the input.
        channels: Channels at 1/2, 1/4, 1/8, 1/16, 1/32.
    """

    def __init__(self, in_channels: int, channels: tuple[int, ...]) -> None:
        super().__init__()
        self.stem = ConvBlock(in_channels, channels[0], kernel=7, stride=2)
        self.pool = nn.MaxPool2d(3, 2, 1)
        levels: list[nn.Module] = []
        for index in range(1, len(channels)):
            stride = 1 if index == 1 else 2
            levels.append(
                nn.Sequential(
                    ResidualBlock(channels[index - 1], channels[index], stride),
                    ResidualBlock(channels[index], channels[index]),
                )
            )
        self.levels = nn.ModuleList(levels)

    def forward(self, x: Tensor) -> list[Tensor]:
        """Takes (B, C, H, W) to five maps, finest first."""
        maps = [self.stem(x)]
        x = self.pool(maps[0])
        for level in self.levels:
            x = level(x)
            maps.append(x)
        return maps


class QuarterEncoder(nn.Module):
    """Encoder that spends nothing at 1/1 and little at 1/2: two strided convolutions, then residual blocks.

    Args:
        planes: Planes at a quarter of the image's size that join the image there.
        channels: Channels at 1/4, 1/8, 1/16, 1/32.
        blocks: Residual blocks at each of these.
        context: Channels of other maps of the image, which join at 1/8, 1/16, 1/32, and, from 1/64, at 1/32; or none.
        instance_norm: On how many levels, finest first, norms go by each image's own statistics, so that these levels
            carry none of the pictures that they were trained on: IBN-Net ([Pan2018]). From 1 on, the stem's, too.
    """

    def __init__(
        self,
        planes: int,
        channels: tuple[int, ...],
        blocks: tuple[int, ...],
        context: tuple[int, ...] = (),
        instance_norm: int = 0,
    ) -> None:
        super().__init__()
        own = instance_norm > 0
        self.stem = nn.Sequential(
            ConvBlock(3, 16, stride=2, instance=own, raw=True), Projection(16, channels[0], 3, stride=2, instance=own)
        )
        self.join = Projection(planes, channels[0], 3, raw=True)
        self.activation = nn.LeakyReLU(LEAK, inplace=True)
        self.levels = nn.ModuleList(
            _level(channels[max(i - 1, 0)], channels[i], 1 if i == 0 else 2, blocks[i], i < instance_norm)
            for i in range(len(channels))
        )
        joins = [Projection(width, out) for width, out in zip(context, (*channels[1:], channels[-1]), strict=False)]
        # 0 at first, so that training starts as without.
        for join in joins:
            nn.init.zeros_(join.get_parameter("1.weight"))
        self.context = nn.ModuleList([nn.Identity(), *joins[:3]] if context else [nn.Identity() for _ in channels])
        self.scene = joins[3] if context else None

    def forward(self, image: Tensor, planes: Tensor, context: list[Tensor]) -> list[Tensor]:
        """Takes (B, 3, H, W), (B, planes, H / 4, W / 4) float32 and the context to maps at 1/4, 1/8, 1/16, 1/32."""
        x = self.activation(self.stem(image).add_(self.join(planes)))
        maps: list[Tensor] = []
        for level, join in zip(self.levels, self.context, strict=False):
            x = level(x)
            if 0 < len(maps) <= len(context):
                x = x + join(context[len(maps) - 1].to(x.dtype))
            if len(maps) == 3 and self.scene is not None:
                whole = self.scene(context[3].to(x.dtype))
                x = x + functional.interpolate(whole, size=(x.shape[2], x.shape[3]), mode="nearest")
            maps.append(x)
        return maps


class PlanarConv(InFloat32):
    """1x1 convolution of a map with channels last in memory to one with rows together: no copy in between; in float32.

    Args:
        in_channels: Channels of the map.
        bias: (out_channels,), what it gives before training: its weights are 0.
    """

    def __init__(self, in_channels: int, bias: Tensor) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(len(bias), in_channels, 1, 1))
        self.bias = nn.Parameter(bias)

    def compute(self, x: Tensor) -> Tensor:
        pixels = x.permute(0, 2, 3, 1).flatten(1, 2).transpose(1, 2)
        weight = self.weight.flatten(1).unsqueeze(0).expand(x.shape[0], -1, -1)
        planes = torch.baddbmm(self.bias.reshape(1, -1, 1), weight, pixels)
        return planes.reshape(x.shape[0], -1, x.shape[2], x.shape[3])


class RoundedPlanarConv(PlanarConv):
    """A `PlanarConv` in the network's format, for what needs no more digits than that; its result is float32."""

    keeps_float32 = False

    def forward(self, x: Tensor) -> Tensor:
        """(B, in_channels, h, w) to (B, out_channels, h, w) float32."""
        return self.compute(x).float()


def _level(in_channels: int, out_channels: int, stride: int, blocks: int, instance: bool) -> nn.Sequential:
    first = ResidualBlock(in_channels, out_channels, stride, instance)
    others = (ResidualBlock(out_channels, out_channels, instance=instance) for _ in range(blocks - 1))
    return nn.Sequential(first, *others)


class UpBlock(nn.Module):
    """Doubles the size (nearest), joins a skip connection, convolves."""

    def __init__(self, in_channels: int, skip_channels: int, out_channels: int) -> None:
        super().__init__()
        self.conv = ConvBlock(in_channels + skip_channels, out_channels)

    def forward(self, x: Tensor, skip: Tensor) -> Tensor:
        joined = torch.cat([double(x), skip], dim=1)
        result: Tensor = self.conv(joined)
        return result


class UpSum(nn.Module):
    """Doubles the size (nearest), adds a skip connection, convolves.

    Both are brought to the output's width first, the coarse one while it is small: half the cost of `UpBlock`.
    """

    def __init__(self, in_channels: int, skip_channels: int, out_channels: int) -> None:
        super().__init__()
        self.reduce = Projection(in_channels, out_channels)
        self.lateral = Projection(skip_channels, out_channels)
        self.activation = nn.LeakyReLU(LEAK, inplace=True)
        self.conv = ConvBlock(out_channels, out_channels)

    def forward(self, x: Tensor, skip: Tensor) -> Tensor:
        result: Tensor = self.conv(self.activation(double(self.reduce(x)).add_(self.lateral(skip))))
        return result


class HereAndAround(nn.Module):
    """What is at a pixel, by a 1x1 convolution, plus what is around it, by a 3x3 one at half the size.

    Args:
        in_channels: Of the map.
        out_channels: Of the result.
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.here = Projection(in_channels, out_channels)
        self.around = Projection(in_channels, out_channels, 3)

    def forward(self, x: Tensor) -> Tensor:
        """Takes (B, in_channels, H, W), H and W even, to (B, out_channels, H, W), not activated."""
        result: Tensor = self.here(x) + double(self.around(functional.avg_pool2d(x, 2)))
        return result


def double(x: Tensor) -> Tensor:
    """Doubles height and width, each value repeated."""
    return functional.interpolate(x, scale_factor=2.0, mode="nearest")


def reduced(image: Tensor, factor: int) -> Tensor:
    """Means of squares of factor x factor pixels: (B, 3, H, W) to (B, 3, H / factor, W / factor) float32.

    A convolution of each channel: with three channels last in memory `avg_pool2d` is slow.
    """
    weight = torch.full([3, 1, factor, factor], 1.0 / (factor * factor), device=image.device)
    return functional.conv2d(image.float(), weight, stride=factor, groups=3)
