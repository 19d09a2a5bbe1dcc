"""The flat road for networks whose papers do not have it.

How high a camera is and where its horizon lies cannot be seen in a picture that was cropped, scaled or taken by another
car. A network that is told sees how far the road is, and where a thing that stands on it ends.
"""

from typing import Final

import torch
from torch import Tensor, nn

from radcam_depth_ros.networks.layers.rasterise import CELL_PX, depth_to_plane, draw_road


class GroundPrior(nn.Module):
    """The road's depth as an input of the coarsest map, and as a depth that the result may take.

    Args:
        channels: Of the map at 1/32 that it is added to.
        min_depth_m: Nearest depth.
        max_depth_m: Farthest depth.
    """

    stride: Final[int] = CELL_PX

    def __init__(self, channels: int, min_depth_m: float, max_depth_m: float) -> None:
        super().__init__()
        self.min_depth_m = min_depth_m
        self.max_depth_m = max_depth_m
        self.embed = nn.Conv2d(2, channels, 1, bias=False)

    def forward(self, ground: Tensor, x: Tensor) -> Tensor:
        """Adds the road (B, 4), as `interface` has it, to a map (B, channels, h, w) at 1/32."""
        road_m, known = draw_road(
            ground, x.shape[2], x.shape[3], float(self.stride), self.min_depth_m, self.max_depth_m
        )
        plane = depth_to_plane(road_m, self.min_depth_m, self.max_depth_m)
        drawn = torch.cat([plane, known.expand_as(plane)], dim=1).to(x.dtype)
        result: Tensor = x + self.embed(drawn)
        return result

    @torch.jit.export
    def blend(self, depth_m: Tensor, logit: Tensor, ground: Tensor) -> Tensor:
        """A depth with a share of the road's in it.

        Args:
            depth_m: (B, 1, H, W) float32 metres.
            logit: The same size, of the road's share; without a road it has none.
            ground: (B, 4).
        """
        rows, columns = depth_m.shape[2], depth_m.shape[3]
        road_m, known = draw_road(ground, rows, columns, 1.0, self.min_depth_m, self.max_depth_m)
        return depth_m + known * torch.sigmoid(logit.float()) * (road_m - depth_m)
