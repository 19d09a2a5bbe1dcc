"""Stage 1 of `baff`: association of pixels with radar returns ([Electronics2025], section 3.2).

Two forms. The paper's, a decoder pass over each return's region of the image, is in `regions`. `EmbeddingAssociation`
costs one decoder pass however many returns there are: each pixel and each return get a vector, and
C_n(x) = sigmoid(f(x) . g(n) + b_n).
"""

import math
from typing import Final

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.interface import Association
from radcam_depth_ros.networks.layers.blocks import UpSum
from radcam_depth_ros.networks.layers.number_formats import Float32Linear
from radcam_depth_ros.networks.layers.rasterise import CELL_PX, STRIDE, from_cells

FEATURES = (64, 48, 32)
"""Features of the image at 1/16, 1/8 and 1/4; those at 1/4 are given to stage 2."""

FEW = -3.0
"""Logit that training starts from: few pixels belong to a return."""

OUTSIDE = -1.0e4
"""Logit of a pixel outside of a return's region: its probability is 0, and still a number in bfloat16."""


class PointEncoder(nn.Module):
    """Five fully connected layers 32, 64, 128, 128, 128 on each projected return.

    Deviations: the values are normalised (the public baseline takes pixels and metres as they are), the column is left
    out since a region is centred on it, and RCS and radial speed join, since they tell ghosts and clutter.

    Args:
        focal_length_px: The network's focal length: v is normalised by it.
        min_depth_m: Nearest depth.
        max_depth_m: Farthest depth.
    """

    def __init__(self, focal_length_px: float, min_depth_m: float, max_depth_m: float) -> None:
        super().__init__()
        self.focal_length_px = focal_length_px
        self.min_depth_m = min_depth_m
        self.max_depth_m = max_depth_m
        layers: list[nn.Module] = []
        width = 8
        for out in (32, 64, 128, 128, 128):
            layers += [nn.Linear(width, out), nn.LeakyReLU(0.2)]
            width = out
        self.layers = nn.Sequential(*layers)

    def forward(self, radar: Tensor, height: int, dtype: torch.dtype) -> Tensor:
        """Takes (B, N, 6) returns on an image of that height to (B, N, 128) of that type."""
        v, depth = radar[:, :, 1], radar[:, :, 2].clamp(self.min_depth_m, self.max_depth_m)
        rcs, speed = radar[:, :, 3], radar[:, :, 4]
        log_depth = torch.log(depth / self.min_depth_m) / math.log(self.max_depth_m / self.min_depth_m)
        features = torch.stack(
            [
                (v - 0.5 * height) / self.focal_length_px,
                log_depth,
                depth / self.max_depth_m,
                10.0 / (depth + 10.0),
                # Some radars give a level above their noise in place of a cross section: up to 100 dB.
                (torch.nan_to_num(rcs) / 20.0).clamp(-3.0, 5.0),
                torch.isfinite(rcs).to(radar.dtype),
                (torch.nan_to_num(speed) / 20.0).clamp(-3.0, 3.0),
                torch.isfinite(speed).to(radar.dtype),
            ],
            dim=2,
        )
        result: Tensor = self.layers(features.to(dtype))
        return result


class EmbeddingAssociation(nn.Module):
    """Association by embedding, at a quarter of the image's size.

    Each cell of 32 x 32 pixels first finds the returns that its mean vector suits best; its pixels choose among these.
    So nothing of N x H x W is ever computed, let alone held.

    Deviations: g(n) is made of what the radar tells of a return and of the image's features where it projects to, so
    that f(x) . g(n) can say whether both show the same thing. b_n falls with the distance from the return's column and
    from its row, by learned amplitudes of four reaches each: where a pixel lies is known, and need not be learned as
    part of its vector; a radar without height simply gets a flat course along the rows.

    Args:
        channels: Of the encoder's maps at 1/4, 1/8, 1/16, 1/32.
        points: Encoder of the returns.
        dims: Learned part of the vectors.
        region_width_px: Width of a return's region of interest.
        returns_per_cell: Returns that a cell finds.
    """

    reaches: Final[int] = 4
    cell_px: Final[int] = CELL_PX
    stride: Final[int] = STRIDE
    cell: Final[int] = CELL_PX // STRIDE
    outside: Final[float] = OUTSIDE

    def __init__(
        self, channels: tuple[int, ...], points: PointEncoder, dims: int, region_width_px: int, returns_per_cell: int
    ) -> None:
        super().__init__()
        self.region_width_px = region_width_px
        self.dims = dims
        self.returns_per_cell = returns_per_cell
        self.points = points
        self.up_1_16 = UpSum(channels[3], channels[2], FEATURES[0])
        self.up_1_8 = UpSum(FEATURES[0], channels[1], FEATURES[1])
        self.up_1_4 = UpSum(FEATURES[1], channels[0], FEATURES[2])
        self.pixel_head = nn.Conv2d(FEATURES[2], dims, 1)
        self.joint = nn.Sequential(nn.Linear(128 + FEATURES[2] + FEATURES[1], 128), nn.LeakyReLU(0.2))
        self.point_head = Float32Linear(128, dims + 2 * self.reaches + 1)
        self.reach_px = (8.0, 24.0, 72.0, 216.0)
        nn.init.zeros_(self.point_head.bias)
        nn.init.constant_(self.point_head.bias[-1], FEW)

    def forward(self, image: Tensor, maps: list[Tensor], radar: Tensor, valid: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Finds each pixel's return.

        Args:
            image: (B, 3, H, W); this form needs its maps only.
            maps: Of the encoder, at 1/4, 1/8, 1/16, 1/32.
            radar: (B, N, 6); N may be 0.
            valid: (B, N) bool.

        Returns:
            The greatest logit (B, 1, H / 4, W / 4) over the returns, the depth of its return, and features of the image
            (B, 32, H / 4, W / 4).
        """
        logits, depths, features = self._hypotheses(maps, radar, valid)
        best, depth = self._strongest(logits, depths)
        rows, columns = maps[3].shape[2], maps[3].shape[3]
        return from_cells(best, rows, columns, self.cell), from_cells(depth, rows, columns, self.cell), features

    def train_outputs(
        self, image: Tensor, maps: list[Tensor], radar: Tensor, valid: Tensor
    ) -> tuple[Association, Tensor, Tensor, Tensor]:
        """As `forward`, and before it the logits of all returns that a pixel chooses between."""
        logits, depths, features = self._hypotheses(maps, radar, valid)
        best, depth = self._strongest(logits.detach(), depths)
        rows, columns = maps[3].shape[2], maps[3].shape[3]
        counts = logits.detach() > 0.5 * self.outside
        depths = torch.where(counts, depths.unsqueeze(3).expand_as(logits), torch.nan)
        association = Association(
            from_cells(logits.transpose(1, 2), rows, columns, self.cell),
            from_cells(depths.transpose(1, 2), rows, columns, self.cell),
            None,
        )
        best, depth = from_cells(best, rows, columns, self.cell), from_cells(depth, rows, columns, self.cell)
        return association, best, depth, features

    def _hypotheses(self, maps: list[Tensor], radar: Tensor, valid: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Logits (B, cells, K, 64) of the K returns of each cell, their depths (B, cells, K), features."""
        batch, rows, columns = maps[3].shape[0], maps[3].shape[2], maps[3].shape[3]
        x_1_8 = self.up_1_8(self.up_1_16(maps[3], maps[2]), maps[1])
        features = self.up_1_4(x_1_8, maps[0])
        pixels = self.pixel_head(features)
        # As many padding rows as a cell has returns, so that there are always enough.
        radar = functional.pad(radar, (0, 0, 0, self.returns_per_cell), value=1.0)
        valid = functional.pad(valid, (0, self.returns_per_cell), value=False)
        known = self.points(radar, rows * self.cell_px, pixels.dtype)
        seen_1_4, seen_1_8 = _sample(features, radar, 4), _sample(x_1_8, radar, 8)
        points = self.point_head(self.joint(torch.cat([known, seen_1_4.to(known.dtype), seen_1_8.to(known.dtype)], 2)))
        index = self._choose(pixels, points, radar, valid)
        # All of a cell's returns, as rows: (B cells, K, values).
        values = torch.cat([points.float(), radar[:, :, :3].float(), valid.float().unsqueeze(2)], dim=2)
        first = torch.arange(batch, device=index.device).reshape(-1, 1, 1) * radar.shape[1]
        chosen = values.flatten(0, 1).index_select(0, (index + first).flatten())
        chosen = chosen.reshape(batch * rows * columns, self.returns_per_cell, values.shape[2])
        inside = pixels.reshape(batch, self.dims, rows, self.cell, columns, self.cell).permute(0, 2, 4, 3, 5, 1)
        inside = inside.reshape(batch * rows * columns, self.cell * self.cell, self.dims)
        logits = torch.bmm(chosen[:, :, : self.dims].to(inside.dtype), inside.transpose(1, 2)).float()
        cell = torch.arange(rows * columns, device=index.device).repeat(batch)
        left, top = cell % columns, torch.div(cell, columns, rounding_mode="floor")
        middle, end = self.dims + self.reaches, self.dims + 2 * self.reaches
        by_column, distance = self._course(chosen[:, :, self.dims : middle], chosen[:, :, end + 1], left)
        by_row, _ = self._course(chosen[:, :, middle:end], chosen[:, :, end + 2], top)
        usable = (distance <= 0.5 * self.region_width_px) & (chosen[:, :, -1:] > 0)
        by_column = torch.where(usable, by_column + chosen[:, :, end : end + 1], self.outside)
        logits = logits.reshape(-1, self.returns_per_cell, self.cell, self.cell)
        logits = logits + (by_column.unsqueeze(2) + by_row.unsqueeze(3))
        logits = logits.reshape(batch, rows * columns, self.returns_per_cell, self.cell * self.cell)
        depths = chosen[:, :, end + 3].reshape(batch, rows * columns, self.returns_per_cell)
        return logits, depths, features

    def _choose(self, pixels: Tensor, points: Tensor, radar: Tensor, valid: Tensor) -> Tensor:
        """The returns of each cell, (B, cells, K) int64: those that its mean vector suits best."""
        cells = functional.avg_pool2d(pixels.detach(), self.cell)
        batch, rows, columns = cells.shape[0], cells.shape[2], cells.shape[3]
        points = points.detach()
        products = torch.bmm(points[:, :, : self.dims].to(cells.dtype), cells.flatten(2)).float()
        points, radar = points.float(), radar.float()
        middle, end = self.dims + self.reaches, self.dims + 2 * self.reaches
        by_column, distance = self._coarse_course(points[:, :, self.dims : middle], radar[:, :, 0], columns)
        by_row, _ = self._coarse_course(points[:, :, middle:end], radar[:, :, 1], rows)
        # A cell that the region reaches into at all.
        usable = (distance <= 0.5 * (self.region_width_px + self.cell_px)) & valid.unsqueeze(2)
        by_column = torch.where(usable, by_column + points[:, :, end:], self.outside)
        scores = products.reshape(batch, -1, rows, columns) + (by_column.unsqueeze(2) + by_row.unsqueeze(3))
        return torch.topk(scores.flatten(2).transpose(1, 2), self.returns_per_cell, dim=2, sorted=False)[1]

    def _coarse_course(self, amplitudes: Tensor, centre: Tensor, count: int) -> tuple[Tensor, Tensor]:
        """As `_course`, at the middle of `count` cells: two (B, N, count) of (B, N, reaches) and (B, N)."""
        place = (torch.arange(count, device=centre.device, dtype=torch.float32) + 0.5) * self.cell_px - 0.5
        return self._fall(amplitudes, (place - centre.unsqueeze(2)).abs())

    def _course(self, amplitudes: Tensor, centre: Tensor, cell: Tensor) -> tuple[Tensor, Tensor]:
        """How b_n falls along an axis within cells, and the distance in pixels.

        Args:
            amplitudes: (cells, K, reaches).
            centre: (cells, K) pixel of the returns.
            cell: (cells,) which cell it is along the axis.

        Returns:
            Two (cells, K, 8).
        """
        offset = (torch.arange(self.cell, device=centre.device, dtype=torch.float32) + 0.5) * self.stride - 0.5
        place = (cell * float(self.cell_px)).unsqueeze(1) + offset
        return self._fall(amplitudes, (place.unsqueeze(1) - centre.unsqueeze(2)).abs())

    def _fall(self, amplitudes: Tensor, distance: Tensor) -> tuple[Tensor, Tensor]:
        course = torch.zeros_like(distance)
        for index, reach in enumerate(self.reach_px):
            course = course + amplitudes[:, :, index : index + 1] * torch.exp(-distance / reach)
        return course, distance

    def _strongest(self, logits: Tensor, depths: Tensor) -> tuple[Tensor, Tensor]:
        """Greatest logit (B, 1, cells, 64) and the depth of its return."""
        best, index = logits.max(dim=2)
        return best.unsqueeze(1), torch.gather(depths, 2, index).unsqueeze(1)


def _sample(level: Tensor, radar: Tensor, stride: int) -> Tensor:
    """Features (B, N, C) of a map (B, C, h, w) at the pixel that shows each return, or the nearest at the border."""
    height, width = level.shape[2], level.shape[3]
    column = torch.floor((radar[:, :, 0] + 0.5) / stride).clamp(0, width - 1)
    row = torch.floor((radar[:, :, 1] + 0.5) / stride).clamp(0, height - 1)
    # Rows of (B h w, C), which lie together in memory where channels are last.
    first = torch.arange(level.shape[0], device=level.device).reshape(-1, 1) * (height * width)
    index = ((row * width + column).long() + first).flatten()
    pixels = level.permute(0, 2, 3, 1).reshape(-1, level.shape[1])
    return pixels.index_select(0, index).reshape(radar.shape[0], radar.shape[1], level.shape[1])
