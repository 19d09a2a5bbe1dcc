"""Stage 1 in the paper's form: a decoder pass over each region of the image ([Electronics2025], section 3.2)."""

from typing import Final

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.baff.association import FEW, OUTSIDE, PointEncoder
from radcam_depth_ros.networks.config import ArchitectureError
from radcam_depth_ros.networks.interface import Association
from radcam_depth_ros.networks.layers.blocks import ConvBlock, ResidualEncoder, UpBlock, double
from radcam_depth_ros.networks.layers.rasterise import CELL_PX

ENCODER_CHANNELS = (32, 64, 128, 128, 128)


def check_region_width(width_px: int) -> None:
    """Refuses a width of regions that is not a multiple of 32 pixels, by an ArchitectureError."""
    if width_px % CELL_PX or width_px < CELL_PX:
        raise ArchitectureError(f"region_width_px must be a multiple of {CELL_PX}, got {width_px}")


class RegionAssociation(nn.Module):
    """The paper's form: concatenate a return's region of each feature map with its radar map, and decode it.

    Deviation: a region starts at a multiple of 32 pixels, so that its pieces of all five feature maps cover the same
    pixels; its return lies within half a cell of its centre.

    Args:
        points: Encoder of the returns.
        region_width_px: Width of a region, a multiple of 32.
        radar_map_size: Rows and columns of the radar map; it is resized to the region. (28, 9) in the paper.
    """

    features = ENCODER_CHANNELS[1]
    WIDTHS = (256, 128, 64, 32, 16)
    cell_px: Final[int] = CELL_PX
    outside: Final[float] = OUTSIDE

    def __init__(self, points: PointEncoder, region_width_px: int, radar_map_size: tuple[int, int]) -> None:
        super().__init__()
        self.cells = region_width_px // CELL_PX
        self.radar_map_size = radar_map_size
        self.encoder = ResidualEncoder(3, ENCODER_CHANNELS)
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

    def _decode(
        self, maps: list[Tensor], radar: Tensor, valid: Tensor, height: int, width: int
    ) -> tuple[Tensor, Tensor]:
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
        return logits, torch.where(inside, columns, -1)

    def forward(self, image: Tensor, maps: list[Tensor], radar: Tensor, valid: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Finds each pixel's return.

        Args:
            image: (B, 3, H, W).
            maps: Not needed: this form has an encoder of its own.
            radar: (B, N, 6); N may be 0.
            valid: (B, N) bool.

        Returns:
            The greatest logit (B, 1, H, W) over the returns, the depth of its return, and features of the image
            (B, 64, H / 4, W / 4).
        """
        _, _, best, depth, features = self._all(image, radar, valid)
        return best, depth, features

    def train_outputs(
        self, image: Tensor, maps: list[Tensor], radar: Tensor, valid: Tensor
    ) -> tuple[Association, Tensor, Tensor, Tensor]:
        """As `forward`, and before it all logits."""
        logits, columns, best, depth, features = self._all(image, radar, valid)
        depths = radar[:, :, 2].unsqueeze(2).unsqueeze(3)
        return Association(logits[:, :-2], depths, columns[:, :-2]), best, depth, features

    def _all(self, image: Tensor, radar: Tensor, valid: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        # Two padding rows: N is never 0, nor 1, which torch.export takes for fixed.
        radar = functional.pad(radar, (0, 0, 0, 2), value=1.0)
        valid = functional.pad(valid, (0, 2), value=False)
        maps = self.encoder(image)
        logits, columns = self._decode(maps, radar, valid, image.shape[2], image.shape[3])
        best, depth = _paint(logits.detach(), columns, radar[:, :, 2], image.shape[3], self.outside)
        return logits, columns, best, depth, maps[1]


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
