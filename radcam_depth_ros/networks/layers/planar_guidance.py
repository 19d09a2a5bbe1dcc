"""The decoder of BTS: depth by local planar guidance ([Lee2019]), with radar joining in."""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.layers.blocks import double
from radcam_depth_ros.networks.layers.number_formats import Float32Conv2d

WIDTHS = (512, 512, 256, 128, 64, 32)
"""Channels of the decoder's maps, coarsest first: of what comes in at 1/32, then at 1/16, 1/8, 1/4, 1/2, 1."""

CONTEXT_WIDTH = 128
"""Channels at 1/8 after the atrous convolutions."""

DILATIONS = (3, 6, 12, 18, 24)

STEEPEST = math.pi / 3
"""Largest angle of a local plane to the image plane."""

_LEAST_DIVISOR = 0.1
"""At an edge of its cell a steep plane may run through the camera: so much of its distance is the nearest it gets."""


class UpConv(nn.Module):
    """Doubles the size (nearest), convolves, ELU."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(in_channels, out_channels, 3, padding=1, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        return functional.elu(self.conv(double(x)))


class ConvElu(nn.Sequential):
    """Convolution and ELU, without a norm."""

    def __init__(self, in_channels: int, out_channels: int, kernel: int = 3) -> None:
        super().__init__(
            nn.Conv2d(in_channels, out_channels, kernel, padding=kernel // 2, bias=False), nn.ELU(inplace=True)
        )


class AtrousConv(nn.Sequential):
    """1x1 and 3x3 convolution, the second with holes; `norm` puts a batch norm before."""

    def __init__(self, in_channels: int, out_channels: int, dilation: int, norm: bool) -> None:
        super().__init__(
            nn.BatchNorm2d(in_channels) if norm else nn.Identity(),
            nn.ReLU(),
            nn.Conv2d(in_channels, 2 * out_channels, 1, bias=False),
            nn.BatchNorm2d(2 * out_channels),
            nn.ReLU(inplace=True),
            nn.Conv2d(2 * out_channels, out_channels, 3, padding=dilation, dilation=dilation, bias=False),
        )


class Context(nn.Module):
    """Dense atrous pyramid at 1/8: each of its convolutions sees the results of those with smaller holes."""

    def __init__(self, skip_channels: int) -> None:
        super().__init__()
        width, out = WIDTHS[2], CONTEXT_WIDTH
        self.atrous = nn.ModuleList([AtrousConv(width, out, DILATIONS[0], norm=False)])
        for index, dilation in enumerate(DILATIONS[1:]):
            self.atrous.append(AtrousConv(width + skip_channels + (index + 1) * out, out, dilation, norm=True))
        self.conv = ConvElu(width + len(DILATIONS) * out, out)

    def forward(self, x: Tensor, joined: Tensor) -> Tensor:
        """Takes the map, and the up-sampled map with its skip connection that it was made from."""
        seen, made = [joined], [x]
        for index, layer in enumerate(self.atrous):
            y = layer(x) if index == 0 else layer(torch.cat(seen, dim=1))
            seen.append(y)
            made.append(y)
        result: Tensor = self.conv(torch.cat(made, dim=1))
        return result


class Reduction(nn.Sequential):
    """1x1 convolutions that halve the channels down to 8, and one to the result.

    Args:
        in_channels: Of the map.
        first: Channels after the first convolution.
        out_channels: Of the result.
    """

    def __init__(self, in_channels: int, first: int, out_channels: int) -> None:
        layers: list[nn.Module] = []
        while first >= 8:
            layers.append(ConvElu(in_channels, first, kernel=1))
            in_channels, first = first, first // 2
        super().__init__(*layers, Float32Conv2d(in_channels, out_channels, 1, bias=False))


class PlanarGuidance(nn.Module):
    """A plane for each cell, drawn at the image's size.

    Args:
        factor: Side of a cell in pixels.
        max_depth_m: Farthest depth.
    """

    def __init__(self, factor: int, max_depth_m: float) -> None:
        super().__init__()
        self.factor = factor
        self.max_depth_m = max_depth_m
        self.steepest = STEEPEST
        self.full_turn = 2 * math.pi
        self.least_divisor = _LEAST_DIVISOR

    def forward(self, raw: Tensor) -> tuple[Tensor, Tensor]:
        """Draws the planes.

        Args:
            raw: (B, 3, h, w), unbounded values for polar angle, azimuth and distance.

        Returns:
            (B, 1, H, W) float32 metres, and the same at twice the size of `raw`: single pixels, since depths are not
            blended.
        """
        polar, azimuth, distance = (
            torch.sigmoid(raw.float()).reshape(raw.shape[0], 3, raw.shape[2], 1, raw.shape[3], 1).unbind(1)
        )
        polar, azimuth = polar * self.steepest, azimuth * self.full_turn
        # Where in its cell a pixel is, -0.5 to 0.5 from edge to edge.
        place = (torch.arange(self.factor, device=raw.device, dtype=torch.float32) + 0.5) / self.factor - 0.5
        u, v = place.reshape(1, 1, 1, 1, -1), place.reshape(1, 1, -1, 1, 1)
        divisor = torch.sin(polar) * (torch.cos(azimuth) * u + torch.sin(azimuth) * v) + torch.cos(polar)
        # Deviation: BTS divides by whatever comes, 0 and negative numbers included, and bounds nothing.
        depth = distance * self.max_depth_m / divisor.clamp(min=self.least_divisor)
        depth = depth.clamp(max=self.max_depth_m)
        rows, columns = raw.shape[2], raw.shape[3]
        step = self.factor // 2
        thinned = depth[:, :, step // 2 :: step, :, step // 2 :: step].reshape(raw.shape[0], 1, rows * 2, columns * 2)
        return depth.reshape(raw.shape[0], 1, rows * self.factor, columns * self.factor), thinned


class PlanarDecoder(nn.Module):
    """Decodes an image's maps to depth; the radar's maps are added to its own as it goes.

    Args:
        skips: Channels of the image's maps at 1/2, 1/4, 1/8, 1/16, 1/32; the last must be WIDTHS[0].
        max_depth_m: Farthest depth.
        out_channels: Of the result.
    """

    RADAR_CHANNELS = (WIDTHS[4], WIDTHS[3], CONTEXT_WIDTH, WIDTHS[1], WIDTHS[0])
    """Channels that the radar's maps need at 1/2, 1/4, 1/8, 1/16, 1/32 to be added."""

    def __init__(self, skips: tuple[int, ...], max_depth_m: float, out_channels: int) -> None:
        super().__init__()
        self.max_depth_m = max_depth_m
        _, at_16, at_8, at_4, at_2, at_1 = WIDTHS
        self.up_16 = nn.Sequential(UpConv(skips[4], at_16), nn.BatchNorm2d(at_16))
        self.conv_16 = ConvElu(at_16 + skips[3], at_16)
        self.up_8 = nn.Sequential(UpConv(at_16, at_8), nn.BatchNorm2d(at_8))
        self.conv_8 = nn.Sequential(ConvElu(at_8 + skips[2], at_8), nn.BatchNorm2d(at_8))
        self.context = Context(skips[2])
        self.plane_8 = Reduction(CONTEXT_WIDTH, CONTEXT_WIDTH, 3)
        self.guidance_8 = PlanarGuidance(8, max_depth_m)
        self.up_4 = nn.Sequential(UpConv(CONTEXT_WIDTH, at_4), nn.BatchNorm2d(at_4))
        self.conv_4 = ConvElu(at_4 + skips[1] + 1, at_4)
        self.plane_4 = Reduction(at_4, at_4 // 2, 3)
        self.guidance_4 = PlanarGuidance(4, max_depth_m)
        self.up_2 = nn.Sequential(UpConv(at_4, at_2), nn.BatchNorm2d(at_2))
        self.conv_2 = ConvElu(at_2 + skips[0] + 1, at_2)
        self.plane_2 = Reduction(at_2, at_2 // 2, 3)
        self.guidance_2 = PlanarGuidance(2, max_depth_m)
        self.up_1 = UpConv(at_2, at_1)
        self.reduce_1 = Reduction(at_1, at_1 // 2, 1)
        self.conv_1 = ConvElu(at_1 + 4, at_1)
        self.head = Float32Conv2d(at_1, out_channels, 3, padding=1, bias=False)

    def forward(self, image: list[Tensor], radar: list[Tensor]) -> tuple[Tensor, list[Tensor], list[Tensor]]:
        """Decodes.

        Args:
            image: Maps at 1/2, 1/4, 1/8, 1/16, 1/32.
            radar: The same, of `RADAR_CHANNELS`.

        Returns:
            The result (B, out_channels, H, W); the decoder's maps at 1/16, 1/8, 1/4, 1/2, 1; and what the local
            planes at 1/8, 1/4, 1/2 say, each (B, 1, H, W) float32 metres.
        """
        x = self.up_16(image[4] + radar[4])
        x_16 = self.conv_16(torch.cat([x, image[3]], dim=1)) + radar[3]
        joined = torch.cat([self.up_8(x_16), image[2]], dim=1)
        x_8 = self.context(self.conv_8(joined), joined) + radar[2]
        depth_8, thinned = self.guidance_8(self.plane_8(x_8))
        x = torch.cat([self.up_4(x_8), image[1], (thinned / self.max_depth_m).to(x_8.dtype)], dim=1)
        x_4 = self.conv_4(x) + radar[1]
        depth_4, thinned = self.guidance_4(self.plane_4(x_4))
        x = torch.cat([self.up_2(x_4), image[0], (thinned / self.max_depth_m).to(x_4.dtype)], dim=1)
        x_2 = self.conv_2(x) + radar[0]
        depth_2, _ = self.guidance_2(self.plane_2(x_2))
        x = self.up_1(x_2)
        depths = torch.cat([depth_8, depth_4, depth_2], dim=1) / self.max_depth_m
        x_1 = self.conv_1(torch.cat([x, torch.sigmoid(self.reduce_1(x)).to(x.dtype), depths.to(x.dtype)], dim=1))
        return self.head(x_1), [x_16, x_8, x_4, x_2, x_1], [depth_8, depth_4, depth_2]
