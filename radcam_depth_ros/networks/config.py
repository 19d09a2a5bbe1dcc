"""Holds the base of all networks' architectures, and its checks."""

import math
from dataclasses import dataclass

from radcam_depth_ros.frame import RadcamDepthError


class ArchitectureError(RadcamDepthError):
    """A network's name or architecture that cannot be built."""


@dataclass(frozen=True)
class NetworkConfig:
    """Base of the networks' architectures.

    Attributes:
        threshold: tau, from which on a pixel has a semi-dense depth; of what, its network tells.
        min_depth_m: Nearest depth that the network gives.
        max_depth_m: Farthest depth that the network gives.
        focal_length_px: The focal length that it is trained at.
        calibration: Scale and offset of the confidence's logit, see `layers.heads`; (1, 0) leaves it as it is.
    """

    threshold: float = 0.25
    min_depth_m: float = 1.0
    max_depth_m: float = 100.0
    focal_length_px: float = 315.0
    calibration: tuple[float, float] = (1.0, 0.0)

    def __post_init__(self) -> None:
        if not 0 < self.threshold < 1:
            raise ArchitectureError(f"threshold must lie between 0 and 1, got {self.threshold}")
        if not 0 < self.min_depth_m < self.max_depth_m:
            raise ArchitectureError(
                f"the depth range must be 0 < min < max metres, got {self.min_depth_m} to {self.max_depth_m}"
            )
        scale, offset = self.calibration
        if not (math.isfinite(scale) and scale > 0 and math.isfinite(offset)):
            raise ArchitectureError(f"calibration needs a scale above 0 and an offset, got {list(self.calibration)}")
        if self.focal_length_px <= 0:
            raise ArchitectureError(f"focal_length_px must be positive, got {self.focal_length_px}")
