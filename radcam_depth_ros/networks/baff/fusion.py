"""Gates, bidirectional fusion and refinement: the blocks of stage 2 ([Electronics2025], sections 3.3 to 3.5)."""

import itertools

import torch
from torch import Tensor, nn

from radcam_depth_ros.networks.baff.attention import ParallelAttention
from radcam_depth_ros.networks.layers.blocks import ConvBlock, Projection, double


class Gate(nn.Module):
    """P_i = Conv1x1(I_f + D_f * sigmoid(Conv(D_f))), [Electronics2025], eq. 3 and 4, which names no sigmoid.

    Args:
        channels: Of both maps.
        kernel: Of the convolution of D_f.
    """

    def __init__(self, channels: int, kernel: int) -> None:
        super().__init__()
        self.weight = nn.Conv2d(channels, channels, kernel, padding=kernel // 2)
        # Normalised, since what goes down is a sum over all levels: without, the coarsest one outgrows the others.
        self.project = Projection(channels, channels)

    def forward(self, image: Tensor, depth: Tensor) -> Tensor:
        result: Tensor = self.project(torch.addcmul(image, depth, self.weight(depth).sigmoid_()))
        return result


class Gates(nn.Module):
    """A gate at each level."""

    def __init__(self, channels: tuple[int, ...], kernel: int) -> None:
        super().__init__()
        self.levels = nn.ModuleList([Gate(width, kernel) for width in channels])

    def forward(self, image: list[Tensor], depth: list[Tensor]) -> list[Tensor]:
        """Two lists of maps, finest first, to P."""
        fused: list[Tensor] = []
        for index, gate in enumerate(self.levels):
            fused.append(gate(image[index], depth[index]))
        return fused


class UpConv(nn.Module):
    """Conv(Up(x)) plus a finer map, [Electronics2025], eq. 5 and 7; or Up(Conv(x)), a quarter of the cost."""

    def __init__(self, in_channels: int, out_channels: int, coarse: bool) -> None:
        super().__init__()
        self.coarse = coarse
        self.conv = ConvBlock(in_channels, out_channels)

    def forward(self, x: Tensor, finer: Tensor) -> Tensor:
        if self.coarse:
            return double(self.conv(x)).add_(finer)
        result: Tensor = self.conv(double(x)) + finer
        return result


class BidirectionalFusion(nn.Module):
    """Takes P to F' of all levels but the coarsest; without the bottom-up branch (BF) to F.

    Args:
        channels: Of the levels, finest first.
        bottom_up: Whether there is the second branch.
        coarse: Whether convolutions come before up-sampling.
    """

    def __init__(self, channels: tuple[int, ...], bottom_up: bool, coarse: bool) -> None:
        super().__init__()
        count = len(channels) - 1
        # Coarsest first: TorchScript cannot walk a list of modules backwards.
        self.top_down = nn.ModuleList([UpConv(channels[i + 1], channels[i], coarse) for i in reversed(range(count))])
        self.bottom_up = nn.ModuleList()
        if bottom_up:
            first = ConvBlock(channels[0], channels[0])
            self.bottom_up.extend(
                [first, *(ConvBlock(channels[i - 1], channels[i], stride=2) for i in range(1, count))]
            )

    def forward(self, fused: list[Tensor]) -> list[Tensor]:
        # F_n = P_n; F_i = Conv(Up(F_{i+1})) + P_i, eq. 5; F_n itself is not needed after.
        last = len(fused) - 1
        x = fused[last]
        down: list[Tensor] = []
        for index, conv in enumerate(self.top_down):
            x = conv(x, fused[last - 1 - index])
            down.insert(0, x)
        if len(self.bottom_up) == 0:
            return down
        # F'_1 = Conv(F_1) + P_1; F'_i = Conv(Down(F'_{i-1})) + F_i + P_i, eq. 6.
        x = down[0]
        maps: list[Tensor] = []
        for index, conv in enumerate(self.bottom_up):
            x = conv(x) + fused[index]
            if index > 0:
                x.add_(down[index])
            maps.append(x)
        return maps


class Refinement(nn.Module):
    """A_i = Conv(Up(A_{i+1})) + CA(F'_i) + PA(F'_i), [Electronics2025], eq. 7.

    Args:
        channels: Of the levels, finest first.
        pools: How far keys and values of PA are pooled at each of the coarsest levels; finer ones have no attention.
        channel_attention: CA.
        position_attention: PA.
        coarse: Whether convolutions come before up-sampling.
    """

    def __init__(
        self,
        channels: tuple[int, ...],
        pools: tuple[int, ...],
        channel_attention: bool,
        position_attention: bool,
        coarse: bool,
    ) -> None:
        super().__init__()
        # Coarsest first.
        levels = list(reversed(channels))
        self.attention = nn.ModuleList(
            ParallelAttention(width, pool, channel_attention, position_attention)
            for width, pool in zip(levels, reversed(pools), strict=False)
        )
        self.attention.extend(nn.Identity() for _ in range(len(channels) - len(pools)))
        self.up = nn.ModuleList(UpConv(below, width, coarse) for below, width in itertools.pairwise(levels))

    def forward(self, maps: list[Tensor]) -> Tensor:
        """Maps, finest first, to the refined finest one."""
        attended: list[Tensor] = []
        last = len(maps) - 1
        for index, attention in enumerate(self.attention):
            attended.append(attention(maps[last - index]))
        x = attended[0]
        for index, up in enumerate(self.up):
            x = up(x, attended[index + 1])
        return x
