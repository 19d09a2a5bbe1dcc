"""Stage 1 of `baff`: which pixels belong to which radar return (Electronics 2025, section 3.2).

Two forms. `RegionAssociation` is the paper's: a decoder pass over each return's region of the image.
`EmbeddingAssociation` costs one decoder pass however many returns there are: each pixel and each return get a vector,
and C_n(x) = sigmoid(f(x) . g(n) + b_n).
"""

import math
from typing import Final

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.blocks import ConvBlock, ResidualEncoder, UpBlock, double
from radcam_depth_ros.networks.interface import Association

ENCODER_CHANNELS = (32, 64, 128, 128, 128)
FEATURES = 64
"""Features of the image at a quarter of its size, which stage 2 takes from stage 1."""

CELL_PX = 32
"""Size of a cell of the coarsest feature map."""

FEW = -3.0
"""Logit that training starts from: few pixels belong to a return."""

SUPERVISED = 128
"""Returns of a sample whose C_n is trained, the first ones: their order is random in training, and the loss of all
would cost more than the rest of the network. All of them take part in the semi-dense depth."""

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
        """Takes (B, N, 6) float32 returns on an image of that height to (B, N, 128) of the type that layers have."""
        v, depth = radar[:, :, 1], radar[:, :, 2].clamp(self.min_depth_m, self.max_depth_m)
        rcs, speed = radar[:, :, 3], radar[:, :, 4]
        log_depth = torch.log(depth / self.min_depth_m) / math.log(self.max_depth_m / self.min_depth_m)
        features = torch.stack(
            [
                (v - 0.5 * height) / self.focal_length_px,
                log_depth,
                depth / self.max_depth_m,
                10.0 / (depth + 10.0),
                (torch.nan_to_num(rcs) / 20.0).clamp(-3.0, 3.0),
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

    Deviations: g(n) is made of what the radar tells of a return and of the image's features where it projects to, so
    that f(x) . g(n) can say whether both show the same thing. b_n falls with the distance from the return's column and
    from its row, by learned amplitudes of four reaches each: where a pixel lies is known, and need not be learned as
    part of its vector; a radar without height simply gets a flat course along the rows.

    Args:
        in_channels: Planes of the image input.
        points: Encoder of the returns.
        dims: Learned part of the vectors.
        region_width_px: Width of a return's region of interest.
    """

    stride: Final[int] = 4
    reaches: Final[int] = 4
    # The returns are gone through in this many parts, so that N x H x W values are never held at once.
    parts: Final[int] = 8
    outside: Final[float] = OUTSIDE

    def __init__(self, in_channels: int, points: PointEncoder, dims: int, region_width_px: int) -> None:
        super().__init__()
        self.region_width_px = region_width_px
        self.dims = dims
        self.encoder = ResidualEncoder(in_channels, ENCODER_CHANNELS)
        self.points = points
        self.up_1_16 = UpBlock(128, 128, 128)
        self.up_1_8 = UpBlock(128, 128, 96)
        self.up_1_4 = UpBlock(96, 64, FEATURES)
        self.pixel_head = nn.Conv2d(FEATURES, dims, 1)
        self.joint = nn.Sequential(nn.Linear(128 + FEATURES + 96, 128), nn.LeakyReLU(0.2))
        self.point_head = nn.Linear(128, dims + 2 * self.reaches + 1)
        self.reach_px = (8.0, 24.0, 72.0, 216.0)
        nn.init.zeros_(self.point_head.bias)
        nn.init.constant_(self.point_head.bias[-1], FEW)

    def vectors(self, image: Tensor, radar: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Encodes pixels and returns.

        Args:
            image: (B, C, H, W) image planes.
            radar: (B, N, 6); N may be 0.

        Returns:
            f (B, dims, H / 4, W / 4); for each return (B, N, dims + 2 reaches + 1): g, the amplitudes of columns and
            of rows, b; and the features that f is made of (B, FEATURES, H / 4, W / 4).
        """
        maps = self.encoder(image)
        x_1_8 = self.up_1_8(self.up_1_16(maps[4], maps[3]), maps[2])
        x_1_4 = self.up_1_4(x_1_8, maps[1])
        known = self.points(radar, image.shape[2], image.dtype)
        seen_1_4, seen_1_8 = _sample(x_1_4, radar, 4), _sample(x_1_8, radar, 8)
        known = torch.cat([known, seen_1_4.to(known.dtype), seen_1_8.to(known.dtype)], dim=2)
        points: Tensor = self.point_head(self.joint(known))
        pixels: Tensor = self.pixel_head(x_1_4)
        return pixels, points, x_1_4

    def logits(self, pixels: Tensor, points: Tensor, radar: Tensor, valid: Tensor) -> Tensor:
        """Vectors of pixels and returns to logits (B, N, h, w), `OUTSIDE` where a return cannot be."""
        batch, _, height, width = pixels.shape
        learned = points[:, :, : self.dims].to(pixels.dtype)
        first, last = self.dims, self.dims + self.reaches
        by_column, distance = self._course(points[:, :, first:last], radar[:, :, 0:1], width)
        inside = (distance <= 0.5 * self.region_width_px) & valid.unsqueeze(2)
        by_column = torch.where(inside, by_column + points[:, :, -1:].float(), torch.full_like(by_column, self.outside))
        by_row, _ = self._course(points[:, :, self.dims + self.reaches : -1], radar[:, :, 1:2], height)
        products = torch.bmm(learned, pixels.reshape(batch, self.dims, height * width))
        products = products.reshape(batch, radar.shape[1], height, width)
        return products + by_column.to(products.dtype).unsqueeze(2) + by_row.to(products.dtype).unsqueeze(3)

    def _course(self, amplitudes: Tensor, centre: Tensor, size: int) -> tuple[Tensor, Tensor]:
        """How b_n falls along an axis of `size` pixel vectors, (B, N, size), and the distance in pixels."""
        place = (torch.arange(size, device=centre.device, dtype=torch.float32) + 0.5) * self.stride - 0.5
        distance = (place.reshape(1, 1, -1) - centre.float()).abs()
        course = torch.zeros_like(distance)
        for index, reach in enumerate(self.reach_px):
            course = course + amplitudes[:, :, index : index + 1].float() * torch.exp(-distance / reach)
        return course, distance

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Finds each pixel's return.

        Args:
            image: (B, C, H, W) image planes.
            radar: (B, N, 6); N may be 0.
            valid: (B, N) bool.

        Returns:
            The greatest logit (B, 1, H / 4, W / 4) over the returns, the depth of its return, and features of the image
            (B, FEATURES, H / 4, W / 4).
        """
        pixels, points, features = self.vectors(image, radar)
        batch, _, height, width = pixels.shape
        # Two padding rows a part: no part is empty, whatever N is, nor of one row, which torch.export takes for fixed.
        points = functional.pad(points, (0, 0, 0, 2 * self.parts))
        radar, valid = _pad(radar, valid, 2 * self.parts)
        best = torch.full((batch, 1, height, width), self.outside, device=pixels.device, dtype=pixels.dtype)
        depth = torch.zeros_like(best, dtype=torch.float32)
        for part in range(self.parts):
            returns = radar[:, part :: self.parts]
            logits = self.logits(pixels, points[:, part :: self.parts], returns, valid[:, part :: self.parts])
            strongest, chosen = _strongest(logits, returns[:, :, 2])
            better = strongest > best
            best, depth = torch.where(better, strongest, best), torch.where(better, chosen, depth)
        return best, depth, features

    def train_outputs(self, image: Tensor, radar: Tensor, valid: Tensor) -> tuple[Association, Tensor, Tensor, Tensor]:
        """As `forward`, all returns at once, and before it their logits."""
        pixels, points, features = self.vectors(image, radar)
        count = radar.shape[1]
        radar, valid = _pad(radar, valid, 2)
        logits = self.logits(pixels, functional.pad(points, (0, 0, 0, 2)), radar, valid)
        best, depth = _strongest(logits.detach(), radar[:, :, 2])
        column = torch.arange(pixels.shape[3], device=pixels.device).reshape(1, 1, -1)
        centre = (column + 0.5) * self.stride - 0.5
        radar, valid = radar[:, : min(count, SUPERVISED)], valid[:, : min(count, SUPERVISED)]
        inside = ((centre - radar[:, :, 0:1]).abs() <= 0.5 * self.region_width_px) & valid.unsqueeze(2)
        return Association(logits[:, :count], torch.where(inside, column, -1), self.stride), best, depth, features


class RegionAssociation(nn.Module):
    """The paper's form: concatenate a return's region of each feature map with its radar map, and decode it.

    Deviation: a region starts at a multiple of 32 pixels, so that its pieces of all five feature maps cover the same
    pixels; its return lies within half a cell of its centre.

    Args:
        in_channels: Planes of the image input.
        points: Encoder of the returns.
        region_width_px: Width of a region, a multiple of 32.
        radar_map_size: Rows and columns of the radar map; it is resized to the region. (28, 9) in the paper.
    """

    WIDTHS = (256, 128, 64, 32, 16)
    stride: Final[int] = 1
    cell_px: Final[int] = CELL_PX
    outside: Final[float] = OUTSIDE

    def __init__(
        self, in_channels: int, points: PointEncoder, region_width_px: int, radar_map_size: tuple[int, int]
    ) -> None:
        super().__init__()
        self.cells = region_width_px // CELL_PX
        self.radar_map_size = radar_map_size
        self.encoder = ResidualEncoder(in_channels, ENCODER_CHANNELS)
        self.points = points
        self.expand = nn.Linear(128, 128 * radar_map_size[0] * radar_map_size[1])
        self.up_1_16 = UpBlock(256, 128, self.WIDTHS[0])
        self.up_1_8 = UpBlock(self.WIDTHS[0], 128, self.WIDTHS[1])
        self.up_1_4 = UpBlock(self.WIDTHS[1], 64, self.WIDTHS[2])
        self.up_1_2 = UpBlock(self.WIDTHS[2], 32, self.WIDTHS[3])
        self.up_1_1 = ConvBlock(self.WIDTHS[3], self.WIDTHS[4])
        self.head = nn.Conv2d(self.WIDTHS[4], 1, 1)
        with torch.no_grad():
            self.head.bias.fill_(FEW)  # type: ignore[union-attr]  # a Conv2d has a bias unless told otherwise

    def region_logits(self, maps: list[Tensor], radar: Tensor, valid: Tensor, height: int, width: int) -> Association:
        """Decodes each region of an encoded image: logits (B, N, H, region width), and their columns in the image."""
        batch = radar.shape[0]
        start = torch.round(radar[:, :, 0] / self.cell_px - 0.5 * self.cells)
        # A return far outside of the image would have no column in it: its region is all padding.
        start = start.clamp(-self.cells, width // self.cell_px).long()
        cell = start.unsqueeze(2) + torch.arange(self.cells, device=radar.device)
        skips = [_regions(level, cell, width // self.cell_px) for level in maps]
        radar_map = self.expand(self.points(radar, height, maps[0].dtype))
        radar_map = radar_map.reshape(batch * radar.shape[1], 128, self.radar_map_size[0], self.radar_map_size[1])
        radar_map = functional.interpolate(
            radar_map, size=(height // self.cell_px, self.cells), mode="bilinear", align_corners=False
        )
        x = self.up_1_16(torch.cat([skips[4], radar_map.to(skips[4].dtype)], dim=1), skips[3])
        x = self.up_1_8(x, skips[2])
        x = self.up_1_4(x, skips[1])
        x = self.up_1_2(x, skips[0])
        logits = self.head(self.up_1_1(double(x))).reshape(batch, radar.shape[1], height, self.cells * self.cell_px)
        columns = start.unsqueeze(2) * self.cell_px + torch.arange(self.cells * self.cell_px, device=radar.device)
        inside = (columns >= 0) & (columns < width) & valid.unsqueeze(2)
        return Association(logits, torch.where(inside, columns, -1), self.stride)

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Finds each pixel's return; as `EmbeddingAssociation.forward`, but for the features at the image's size."""
        _, best, depth, features = self.train_outputs(image, radar, valid)
        return best, depth, features

    def train_outputs(self, image: Tensor, radar: Tensor, valid: Tensor) -> tuple[Association, Tensor, Tensor, Tensor]:
        """As `forward`, and before it all logits."""
        # Two padding rows, for the reason given in EmbeddingAssociation.forward.
        radar, valid = _pad(radar, valid, 2)
        maps = self.encoder(image)
        association = self.region_logits(maps, radar, valid, image.shape[2], image.shape[3])
        best, depth = _paint(
            association.logits.detach(), association.columns, radar[:, :, 2], image.shape[3], self.outside
        )
        without_padding = Association(association.logits[:, :-2], association.columns[:, :-2], self.stride)
        return without_padding, best, depth, maps[1]


def _pad(radar: Tensor, valid: Tensor, rows: int) -> tuple[Tensor, Tensor]:
    """Adds rows that are no returns."""
    return functional.pad(radar, (0, 0, 0, rows), value=1.0), functional.pad(valid, (0, rows), value=False)


def _strongest(logits: Tensor, depths: Tensor) -> tuple[Tensor, Tensor]:
    """Greatest logit (B, 1, h, w) over the returns (B, N, h, w), and the depth (B, N) of its return; N >= 1."""
    best, index = logits.max(dim=1, keepdim=True)
    chosen = torch.gather(depths.float(), 1, index.flatten(1)).reshape(index.shape)
    return best, chosen


def _sample(level: Tensor, radar: Tensor, stride: int) -> Tensor:
    """Features (B, N, C) of a map (B, C, h, w) at the pixel that shows each return, or the nearest at the border."""
    channels, height, width = level.shape[1], level.shape[2], level.shape[3]
    column = torch.floor((radar[:, :, 0] + 0.5) / stride).clamp(0, width - 1)
    row = torch.floor((radar[:, :, 1] + 0.5) / stride).clamp(0, height - 1)
    index = (row * width + column).long().unsqueeze(1).expand(-1, channels, -1)
    return torch.gather(level.flatten(2), 2, index).transpose(1, 2)


def _regions(level: Tensor, cell: Tensor, image_cells: int) -> Tensor:
    """Cuts regions out of a feature map.

    Args:
        level: (B, C, h, w).
        cell: (B, N, cells) int64, columns of each region in cells of 32 pixels; may lie outside of the map.
        image_cells: Cells across the image.

    Returns:
        (B N, C, h, cells * w / image_cells), zero outside of the map.
    """
    batch, channels, height, width = level.shape
    size = width // image_cells
    column = (cell.unsqueeze(3) * size + torch.arange(size, device=level.device)).flatten(1)
    inside = (column >= 0) & (column < width)
    index = column.clamp(0, width - 1).reshape(batch, 1, 1, -1).expand(-1, channels, height, -1)
    cut = torch.gather(level, 3, index) * inside.reshape(batch, 1, 1, -1).to(level.dtype)
    cut = cut.reshape(batch, channels, height, cell.shape[1], cell.shape[2] * size)
    return cut.permute(0, 3, 1, 2, 4).flatten(0, 1)


def _paint(logits: Tensor, columns: Tensor, depths: Tensor, width: int, outside: float) -> tuple[Tensor, Tensor]:
    """Puts regions back into the image; where they overlap, the greatest logit wins.

    Args:
        logits: (B, N, H, k).
        columns: (B, N, k), -1 for those that are not painted.
        depths: (B, N) metres.
        width: Columns of the image.
        outside: Logit where there is none.

    Returns:
        The greatest logit (B, 1, H, width) and its return's depth.
    """
    batch, _, height, _ = logits.shape
    inside = (columns >= 0).unsqueeze(2)
    row = torch.arange(height, device=logits.device).reshape(1, 1, -1, 1) * width
    place = (row + columns.clamp(min=0).unsqueeze(2)).flatten(1)
    values = torch.where(inside, logits.float(), torch.full_like(logits, outside, dtype=torch.float32)).flatten(1)
    best = torch.full((batch, height * width), outside, device=logits.device, dtype=torch.float32)
    best = best.scatter_reduce(1, place, values, "amax")
    candidates = depths.float().reshape(batch, depths.shape[1], 1, 1).expand_as(logits).flatten(1)
    candidates = torch.where(values >= torch.gather(best, 1, place), candidates, torch.full_like(candidates, 1.0e9))
    nearest = torch.full_like(best, 1.0e9).scatter_reduce(1, place, candidates, "amin")
    return best.reshape(batch, 1, height, width), nearest.reshape(batch, 1, height, width)
