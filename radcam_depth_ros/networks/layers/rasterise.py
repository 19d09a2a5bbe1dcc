"""Radar returns and the flat road as image planes.

What each pixel sees of the returns is found in two steps, so that cost and memory hardly grow with their number: each
cell of 32 x 32 pixels looks up its nearest returns, and its pixels look at these alone.
"""

import math
from typing import Final, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

CELL_PX = 32
"""Size of a cell, and of a pixel of the coarsest feature map."""

STRIDE = 4
"""Planes have a quarter of the image's size."""

PRIOR_PLANES = 4
"""Planes of `Geometry.prior`."""

SHARES = (0.5, 0.1, 0.9)
"""Which weighted quantiles of the returns around a pixel are given as `Geometry.layers`."""


STRIP_PX = 16
"""Width of the strips of the image that have a profile each."""

PROFILE_BINS = 48
"""Bins of a profile, evenly over the logarithm of depth: each is a tenth of the depth."""


class Geometry(NamedTuple):
    """Planes at a quarter of the image's size, float32; depths as `depth_to_plane`.

    prior: (B, 4, h, w): the flat road, whether it is known, the nearest return or the road where that is nearer, and
        how near in the image that return is (1 at it, 0 far away).
    nearest: (B, 1, h, w): the nearest return alone.
    layers: (B, 3, h, w): quantiles `SHARES` of the returns around a pixel.
    drawn: (B, 2, h, w): the returns where they are, 0 elsewhere, and whether there is one.
    profile: (B, PROFILE_BINS, w): how many returns are at a depth around a column, whatever their row.
    """

    prior: Tensor
    nearest: Tensor
    layers: Tensor
    drawn: Tensor
    profile: Tensor


class Rasterise(nn.Module):
    """Draws what is known without looking at the image.

    Args:
        min_depth_m: Nearest depth.
        max_depth_m: Farthest depth.
        ground_prior: Whether to give the road's depth; else it is unknown.
        returns_per_cell: How many returns a cell looks up.
        detail: Parts of a pixel along each axis in `road`.
    """

    cell_px: Final[int] = CELL_PX
    stride: Final[int] = STRIDE
    cell: Final[int] = CELL_PX // STRIDE
    shares: Final[tuple[float, float, float]] = SHARES
    strip_px: Final[int] = STRIP_PX
    bins: Final[int] = PROFILE_BINS

    def __init__(
        self, min_depth_m: float, max_depth_m: float, ground_prior: bool, returns_per_cell: int, detail: int
    ) -> None:
        super().__init__()
        self.min_depth_m = min_depth_m
        self.max_depth_m = max_depth_m
        self.ground_prior = ground_prior
        self.returns_per_cell = returns_per_cell
        self.detail = detail

    def forward(self, radar: Tensor, valid: Tensor, ground: Tensor, height: int, width: int) -> Geometry:
        """Takes (B, N, 6), (B, N), (B, 4) and the image's size; N may be 0."""
        rows, columns = height // self.stride, width // self.stride
        road = self._road(ground, rows, columns, float(self.stride))
        known = (
            torch.nan_to_num(ground[:, 3]).reshape(-1, 1, 1, 1).expand_as(road)
            if self.ground_prior
            else torch.zeros_like(road)
        )
        depth, distance, layers = self._around(radar.float(), valid, height // self.cell_px, width // self.cell_px)
        nearest = self.plane(depth)
        prior = torch.cat([road, known, torch.minimum(road, nearest), torch.exp(-distance / 40.0)], dim=1)
        drawn = draw_nearest(radar, valid, height, width, self.stride)
        hit = drawn > 0
        drawn = torch.cat([torch.where(hit, self.plane(drawn), torch.zeros_like(drawn)), hit.float()], dim=1)
        profile = self._profile(radar.float(), valid, width)
        return Geometry(prior, nearest, self.plane(layers), drawn, profile)

    def _profile(self, radar: Tensor, valid: Tensor, width: int) -> Tensor:
        """Counts of returns by strip of the image and depth, as `Geometry.profile` has them.

        What a radar measures well is range and azimuth; its elevation is off by metres or not measured at all. So a bus
        is a heap of returns at one depth, in its columns but in any row.
        """
        strips = width // self.strip_px
        place = depth_to_plane(radar[:, :, 2], self.min_depth_m, self.max_depth_m) * (self.bins - 1)
        lower = torch.floor(place).clamp(0, self.bins - 2)
        share = (place - lower).clamp(0.0, 1.0)
        strip = torch.floor((radar[:, :, 0] + 0.5) / self.strip_px)
        inside = valid & (strip >= 0) & (strip < strips)
        first = torch.where(inside, strip * self.bins + lower, torch.zeros_like(strip)).long()
        weight = inside.float()
        counts = torch.zeros(radar.shape[0], strips * self.bins, device=radar.device)
        counts = counts.scatter_add(1, first, weight * (1.0 - share)).scatter_add(1, first + 1, weight * share)
        counts = counts.reshape(-1, strips, self.bins).transpose(1, 2)
        # Strips beside count half: an edge of a strip is no edge of a thing.
        beside = functional.pad(counts, (1, 1))
        counts = counts + 0.5 * (beside[:, :, :-2] + beside[:, :, 2:])
        return counts.repeat_interleave(self.strip_px // self.stride, dim=2)

    @torch.jit.export
    def near(self, radar: Tensor, valid: Tensor, ground: Tensor, height: int, width: int) -> Tensor:
        """The nearest return's plane, or the road's where that is nearer, (B, 1, h, w); arguments as in `forward`."""
        depth, _, _ = self._around(radar.float(), valid, height // self.cell_px, width // self.cell_px)
        road = self._road(ground, height // self.stride, width // self.stride, float(self.stride))
        return torch.minimum(road, self.plane(depth))

    @torch.jit.export
    def road(self, ground: Tensor, height: int, width: int) -> Tensor:
        """The flat road's plane of an image of this size, (B, 1, h detail, w detail); `ground` as in `forward`."""
        rows, columns = height // self.stride * self.detail, width // self.stride * self.detail
        return self._road(ground, rows, columns, self.stride / self.detail)

    def _road(self, ground: Tensor, height: int, width: int, stride: float) -> Tensor:
        """The flat road's depth as a plane (B, 1, height, width) of pixels of `stride`; 1, the farthest, without."""
        road_m, known = draw_road(ground, height, width, stride, self.min_depth_m, self.max_depth_m)
        if not self.ground_prior:
            known = torch.zeros_like(known)
        plane = depth_to_plane(road_m, self.min_depth_m, self.max_depth_m)
        return torch.where(known > 0, plane, torch.ones_like(plane))

    def plane(self, depth: Tensor) -> Tensor:
        """Depths as planes; where there is none (0), the farthest."""
        plane = depth_to_plane(depth, self.min_depth_m, self.max_depth_m)
        return torch.where(depth > 0, plane, torch.ones_like(plane))

    def _around(self, radar: Tensor, valid: Tensor, rows: int, columns: int) -> tuple[Tensor, Tensor, Tensor]:
        """Depth of the nearest return, distance to it in pixels, and layers of the returns around, at 1/4.

        A return weighs exp(-r), r being its distance in reaches of 4 px across and 8 px along the column (depth
        changes less along it), wider where even the nearest return is far away. 0 and 1e9 for no return.
        """
        # As many padding rows as a cell looks up, so that there are always enough.
        radar = functional.pad(radar[:, :, :3], (0, 0, 0, self.returns_per_cell), value=1.0)
        valid = functional.pad(valid, (0, self.returns_per_cell), value=False)
        u, v = _centres(columns, float(self.cell_px), radar.device), _centres(rows, float(self.cell_px), radar.device)
        across = u.reshape(1, -1, 1) - radar[:, :, 0].unsqueeze(1)
        along = v.reshape(1, -1, 1) - radar[:, :, 1].unsqueeze(1)
        far = (along / 8.0).square().unsqueeze(2) + (across / 4.0).square().unsqueeze(1)
        far = far.masked_fill(~valid.unsqueeze(1).unsqueeze(2), 1.0e18).flatten(1, 2)
        far, index = torch.topk(far, self.returns_per_cell, dim=2, largest=False, sorted=False)
        # From near to far in depth; those that are none come last and weigh nothing.
        depth = torch.where(far < 1.0e18, gather_rows(radar[:, :, 2], index), torch.full_like(far, 1.0e9))
        depth, order = torch.sort(depth, dim=2)
        index = torch.gather(index, 2, order)
        column, row = gather_rows(radar[:, :, 0], index), gather_rows(radar[:, :, 1], index)
        there = (depth < 1.0e9).unsqueeze(3)
        offset = _centres(self.cell, float(self.stride), radar.device).reshape(1, 1, 1, -1)
        cell = torch.arange(rows * columns, device=radar.device).reshape(1, -1, 1, 1)
        left, top = cell % columns, torch.div(cell, columns, rounding_mode="floor")
        across = (left * float(self.cell_px) + offset - column.unsqueeze(3)).square().unsqueeze(3)
        along = (top * float(self.cell_px) + offset - row.unsqueeze(3)).square().unsqueeze(4)
        # (B, cells, returns_per_cell, 64) from here on.
        squared, nearest = (across + along).flatten(3).masked_fill(~there, 1.0e18).min(dim=2)
        distance = squared.sqrt()
        found = torch.gather(depth, 2, nearest)
        reach = 1.0 + 0.05 * distance.clamp(max=1.0e4)
        scaled = (across / 16.0 + along / 64.0).flatten(3).sqrt()
        # Relative to the nearest return, so that the sum is never 0: at most its own distance, in the smaller reach.
        weight = torch.exp(((distance.clamp(max=1.0e4) / 8.0).unsqueeze(2) - scaled) / reach.unsqueeze(2))
        below = torch.cumsum(weight * there.float(), dim=2)
        total = below[:, :, -1:]
        planes = [found]
        for share in self.shares:
            place = (below < share * total).sum(dim=2).clamp(max=self.returns_per_cell - 1)
            planes.append(torch.gather(depth, 2, place))
        exists = there.any(dim=2).expand_as(found)
        depths = torch.stack(planes, dim=1)
        depths = torch.where(exists.unsqueeze(1), depths, torch.zeros_like(depths))
        depths = torch.cat([depths, distance.unsqueeze(1)], dim=1)
        depths = from_cells(depths, rows, columns, self.cell)
        return depths[:, :1], depths[:, -1:], depths[:, 1:-1]


def support(profile: Tensor, planes: Tensor) -> Tensor:
    """How many returns of its columns are at the depth of a pixel, log(1 + n).

    Args:
        profile: (B, bins, w), as `Geometry.profile`.
        planes: (B, K, h, w), 0 to 1.

    Returns:
        (B, K, h, w).
    """
    bins, rows = profile.shape[1], planes.shape[1] * planes.shape[2]
    place = planes.reshape(planes.shape[0], rows, planes.shape[3]).clamp(0.0, 1.0) * (bins - 1)
    lower = torch.floor(place).clamp(max=bins - 2)
    share = place - lower
    index = lower.long()
    counts = torch.gather(profile, 1, index) * (1.0 - share) + torch.gather(profile, 1, index + 1) * share
    return torch.log1p(counts).reshape(planes.shape)


def peak(profile: Tensor) -> Tensor:
    """The depth at which most returns of a column are, as a plane (B, 1, 1, w); 1, the farthest, for no return."""
    bins = profile.shape[1]
    most, index = (profile[:, 1:-1] + 0.5 * (profile[:, :-2] + profile[:, 2:])).max(dim=1, keepdim=True)
    around = [torch.gather(profile, 1, index + step) for step in range(3)]
    mean = index + (around[1] + 2.0 * around[2]) / (around[0] + around[1] + around[2]).clamp(min=1e-6)
    return torch.where(most > 0, mean / (bins - 1), torch.ones_like(mean)).unsqueeze(1)


def depth_to_plane(depth_m: Tensor, min_depth_m: float, max_depth_m: float) -> Tensor:
    """Depth as an input plane: its logarithm, 0 at the nearest and 1 at the farthest depth, clipped."""
    scaled = torch.log(depth_m.clamp(min_depth_m, max_depth_m) / min_depth_m)
    return scaled / math.log(max_depth_m / min_depth_m)


def plane_to_depth(plane: Tensor, min_depth_m: float, max_depth_m: float) -> Tensor:
    """Inverse of `depth_to_plane` for values of 0 to 1, in float32."""
    return min_depth_m * torch.exp(plane.float() * math.log(max_depth_m / min_depth_m))


def draw_road(
    ground: Tensor, height: int, width: int, stride: float, min_depth_m: float, max_depth_m: float
) -> tuple[Tensor, Tensor]:
    """Draws the flat road.

    Args:
        ground: (B, 4), as `interface` has it.
        height: Rows of the result.
        width: Columns of the result.
        stride: Pixels of the image a pixel of the result.
        min_depth_m: Nearest depth.
        max_depth_m: Farthest depth; that of what is above the horizon, too.

    Returns:
        (B, 1, height, width) float32 metres, and (B, 1, 1, 1), 1 where there is a road and 0 where nothing is assumed.
    """
    known = torch.isfinite(ground).all(dim=1).reshape(-1, 1, 1, 1)
    finite = torch.nan_to_num(ground, nan=0.0, posinf=0.0, neginf=0.0)
    a, b, c, _ = finite.reshape(-1, 4, 1, 1, 1).unbind(1)
    u = _centres(width, stride, ground.device).reshape(1, 1, 1, -1)
    v = _centres(height, stride, ground.device).reshape(1, 1, -1, 1)
    inverse = (a * u + b * v + c).clamp(1.0 / max_depth_m, 1.0 / min_depth_m)
    return 1.0 / inverse, known.to(inverse.dtype)


def draw_nearest(radar: Tensor, valid: Tensor, height: int, width: int, stride: int) -> Tensor:
    """Draws returns as a depth image: each at its pixel, the nearest where several meet, 0 where there is none.

    Args:
        radar: (B, N, 6), columns as `RADAR_COLUMNS`; N may be 0.
        valid: (B, N) bool.
        height: Rows of the image.
        width: Columns of the image.
        stride: Pixels of the image a pixel of the result.

    Returns:
        (B, 1, height / stride, width / stride) float32 metres.
    """
    rows, columns = height // stride, width // stride
    depth = radar[:, :, 2].float()
    place, inside = pixels(radar, valid, rows, columns, stride)
    far = torch.full((radar.shape[0], rows * columns), 1.0e9, device=radar.device)
    drawn = far.scatter_reduce(1, place, torch.where(inside, depth, torch.full_like(depth, 1.0e9)), "amin")
    return torch.where(drawn < 1.0e9, drawn, torch.zeros_like(drawn)).reshape(-1, 1, rows, columns)


def pixels(radar: Tensor, valid: Tensor, rows: int, columns: int, stride: int) -> tuple[Tensor, Tensor]:
    """Where returns lie in an image of rows x columns whose pixels are `stride` wide.

    Returns:
        (B, N) int64, row * columns + column, 0 for those that are not inside; and (B, N) bool, whether they are.
    """
    column = torch.floor((radar[:, :, 0] + 0.5) / stride)
    row = torch.floor((radar[:, :, 1] + 0.5) / stride)
    inside = valid & (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    return torch.where(inside, row * columns + column, torch.zeros_like(row)).long(), inside


def gather_rows(values: Tensor, index: Tensor) -> Tensor:
    """Values (B, N) at (B, cells, K) int64, as (B, cells, K)."""
    return torch.gather(values, 1, index.flatten(1)).reshape(index.shape)


def from_cells(x: Tensor, rows: int, columns: int, size: int) -> Tensor:
    """(B, C, rows columns, size size) to the image (B, C, rows size, columns size)."""
    x = x.reshape(x.shape[0], x.shape[1], rows, columns, size, size).transpose(3, 4)
    return x.reshape(x.shape[0], x.shape[1], rows * size, columns * size)


def _centres(count: int, stride: float, device: torch.device) -> Tensor:
    """Where in the image the pixels of a plane of `stride` are, along an axis: pixel areas scale, not centres."""
    return (torch.arange(count, device=device, dtype=torch.float32) + 0.5) * stride - 0.5
