"""Blocks that the networks share: convolutions, a residual encoder, up-sampling, depth planes."""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

LEAK = 0.2  # METHODS A gives leaky ReLU 0.2 for the public baseline; the paper names no slope.


class ConvBlock(nn.Sequential):
    """Convolution, batch norm, leaky ReLU; `stride` divides the size."""

    def __init__(self, in_channels: int, out_channels: int, kernel: int = 3, stride: int = 1) -> None:
        super().__init__(
            nn.Conv2d(in_channels, out_channels, kernel, stride, kernel // 2, bias=False),
            nn.BatchNorm2d(out_channels),
            nn.LeakyReLU(LEAK, inplace=True),
        )


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions and a shortcut (He et al. 2016, basic block)."""

    def __init__(self, in_channels: int, out_channels: int, stride: int = 1) -> None:
        super().__init__()
        self.first = ConvBlock(in_channels, out_channels, stride=stride)
        self.second = nn.Sequential(
            nn.Conv2d(out_channels, out_channels, 3, padding=1, bias=False), nn.BatchNorm2d(out_channels)
        )
        self.shortcut: nn.Module = nn.Identity()
        if stride != 1 or in_channels != out_channels:
            self.shortcut = nn.Sequential(
                nn.Conv2d(in_channels, out_channels, 1, stride, bias=False), nn.BatchNorm2d(out_channels)
            )
        self.activation = nn.LeakyReLU(LEAK, inplace=True)

    def forward(self, x: Tensor) -> Tensor:
        result: Tensor = self.activation(self.second(self.first(x)) + self.shortcut(x))
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


class UpBlock(nn.Module):
    """Doubles the size (nearest), joins a skip connection, convolves."""

    def __init__(self, in_channels: int, skip_channels: int, out_channels: int) -> None:
        super().__init__()
        self.conv = ConvBlock(in_channels + skip_channels, out_channels)

    def forward(self, x: Tensor, skip: Tensor) -> Tensor:
        joined = torch.cat([double(x), skip], dim=1)
        result: Tensor = self.conv(joined)
        return result


def double(x: Tensor) -> Tensor:
    """Doubles height and width, each value repeated."""
    return functional.interpolate(x, scale_factor=2.0, mode="nearest")


def depth_to_plane(depth_m: Tensor, min_depth_m: float, max_depth_m: float) -> Tensor:
    """Depth as an input plane: its logarithm, 0 at the nearest and 1 at the farthest depth, clipped."""
    scaled = torch.log(depth_m.clamp(min_depth_m, max_depth_m) / min_depth_m)
    return scaled / math.log(max_depth_m / min_depth_m)


def plane_to_depth(plane: Tensor, min_depth_m: float, max_depth_m: float) -> Tensor:
    """Inverse of `depth_to_plane` for values of 0 to 1, in float32."""
    return min_depth_m * torch.exp(plane.float() * math.log(max_depth_m / min_depth_m))


def ground_planes(ground: Tensor, height: int, width: int, min_depth_m: float, max_depth_m: float) -> Tensor:
    """The flat road as two planes: its depth as `depth_to_plane` (1 above the horizon), and whether it is known.

    Args:
        ground: (B, 3) a, b, c of the inverse depth a u + b v + c, NaN where unknown.
        height: Rows of the planes.
        width: Columns of the planes.
        min_depth_m: Depth that becomes 0.
        max_depth_m: Depth that becomes 1.

    Returns:
        (B, 2, height, width); both 0 where the road is unknown.
    """
    known = torch.isfinite(ground).all(dim=1).float().reshape(-1, 1, 1)
    coefficients = torch.nan_to_num(ground, nan=0.0, posinf=0.0, neginf=0.0)
    u = torch.arange(width, device=ground.device, dtype=torch.float32)
    v = torch.arange(height, device=ground.device, dtype=torch.float32)
    a, b, c = coefficients[:, 0], coefficients[:, 1], coefficients[:, 2]
    inverse = a.reshape(-1, 1, 1) * u.reshape(1, 1, -1) + b.reshape(-1, 1, 1) * v.reshape(1, -1, 1)
    inverse = (inverse + c.reshape(-1, 1, 1)).clamp(1.0 / max_depth_m, 1.0 / min_depth_m)
    plane = depth_to_plane(1.0 / inverse, min_depth_m, max_depth_m)
    return torch.stack([plane * known, torch.ones_like(plane) * known], dim=1)


def draw_nearest(radar: Tensor, valid: Tensor, height: int, width: int) -> Tensor:
    """Draws returns as a depth image: each at its pixel, the nearest where several meet, 0 where there is none.

    Args:
        radar: (B, N, 6), columns as `RADAR_COLUMNS`; N may be 0.
        valid: (B, N) bool.
        height: Rows.
        width: Columns.

    Returns:
        (B, 1, height, width) float32 metres.
    """
    column, row, depth = torch.round(radar[:, :, 0]), torch.round(radar[:, :, 1]), radar[:, :, 2].float()
    inside = valid & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    place = torch.where(inside, row * width + column, torch.zeros_like(row)).long()
    far = torch.full((radar.shape[0], height * width), 1.0e9, device=radar.device)
    drawn = far.scatter_reduce(1, place, torch.where(inside, depth, torch.full_like(depth, 1.0e9)), "amin")
    return torch.where(drawn < 1.0e9, drawn, torch.zeros_like(drawn)).reshape(-1, 1, height, width)


def nearest_returns(radar: Tensor, valid: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """The return nearest in the image to each cell of 8 x 8 pixels.

    Args:
        radar: (B, N, 6), columns as `RADAR_COLUMNS`; N may be 0.
        valid: (B, N) bool.
        height: Rows of the image, a multiple of 8.
        width: Columns of the image, a multiple of 8.

    Returns:
        Depth of that return and distance to it in pixels, both (B, 1, height / 8, width / 8); 0 and 1e9 for no return.
    """
    # In eight parts with two padding rows each, for the reasons given in `EmbeddingAssociation.strongest`.
    radar = functional.pad(radar.float(), (0, 0, 0, 16))
    valid = functional.pad(valid, (0, 16), value=False)
    column = (torch.arange(width // 8, device=radar.device) * 8.0 + 3.5).reshape(1, 1, 1, -1)
    row = (torch.arange(height // 8, device=radar.device) * 8.0 + 3.5).reshape(1, 1, -1, 1)
    depth = torch.zeros(radar.shape[0], 1, height // 8, width // 8, device=radar.device)
    best = torch.full_like(depth, 1.0e18)
    for part in range(8):
        returns = radar[:, part::8].unsqueeze(3).unsqueeze(4)
        squared = (column - returns[:, :, 0]).square() + (row - returns[:, :, 1]).square()
        missing = ~valid[:, part::8].unsqueeze(2).unsqueeze(3)
        squared, index = squared.masked_fill(missing, 1.0e18).min(dim=1, keepdim=True)
        chosen = torch.gather(radar[:, part::8, 2], 1, index.flatten(1)).reshape(index.shape)
        depth = torch.where(squared < best, chosen, depth)
        best = torch.minimum(squared, best)
    return depth, best.sqrt()


def return_layers(radar: Tensor, valid: Tensor, distance: Tensor, shares: list[float]) -> Tensor:
    """Depths of the returns around each cell of 8 x 8 pixels, from near to far: weighted quantiles.

    A return weighs exp(-r), r being its distance in reaches of 4 px across and 8 px along the column (depth changes
    less along it), wider where even the nearest return is far away.

    Args:
        radar: (B, N, 6), columns as `RADAR_COLUMNS`; N may be 0.
        valid: (B, N) bool.
        distance: (B, 1, h, w) pixels to the nearest return, of `nearest_returns`.
        shares: The quantiles, 0 to 1.

    Returns:
        (B, len(shares), h, w) metres; 0 where there is no return.
    """
    # Two padding rows, for the reasons given in `EmbeddingAssociation.forward`.
    radar = functional.pad(radar.float(), (0, 0, 0, 2), value=1.0)
    valid = functional.pad(valid, (0, 2), value=False)
    height, width = distance.shape[2], distance.shape[3]
    depth, order = torch.sort(radar[:, :, 2], dim=1)
    column = torch.gather(radar[:, :, 0], 1, order).unsqueeze(2)
    row = torch.gather(radar[:, :, 1], 1, order).unsqueeze(2)
    there = torch.gather(valid, 1, order).reshape(valid.shape[0], -1, 1, 1)
    columns = torch.arange(width, device=radar.device, dtype=torch.float32) * 8.0 + 3.5
    rows = torch.arange(height, device=radar.device, dtype=torch.float32) * 8.0 + 3.5
    across = ((column - columns.reshape(1, 1, -1)) / 4.0).square().unsqueeze(2)
    along = ((row - rows.reshape(1, 1, -1)) / 8.0).square().unsqueeze(3)
    reach = 1.0 + 0.05 * distance.clamp(max=1.0e4)
    # Relative to the nearest return, so that the sum is never 0: at most its own distance, in the smaller reach.
    weight = torch.exp((distance.clamp(max=1.0e4) / 8.0 - (across + along).sqrt()) / reach)
    below = torch.cumsum(weight * there.float(), dim=1)
    total = below[:, -1:]
    last = radar.shape[1] - 1
    layers: list[Tensor] = []
    for share in shares:
        index = (below < share * total).sum(dim=1, keepdim=True).clamp(max=last)
        layers.append(torch.gather(depth, 1, index.flatten(1)).reshape(index.shape))
    result = torch.cat(layers, dim=1)
    return torch.where(total > 0, result, torch.zeros_like(result))
