"""A frame with its ground truth."""

from __future__ import annotations

from dataclasses import dataclass

from radcam_depth_ros.drive.scan_use import ScanUse
from radcam_depth_ros.frame import FloatArray, Frame, ImageArray, RadarReturns


@dataclass(frozen=True)
class Sample:
    """A frame and what is known of its true depth.

    Attributes:
        frame: The frame.
        radars: The radars' topics, in the order of `frame.radar_parts`.
        depth_m: (H, W) float32 true depth at the image's size: NaN unknown, +inf sky. The best there is: exact, else
            accumulated from many LiDAR scans where that was asked for, else of the nearest scan.
        source: Where `depth_m` comes from: `exact`, `lidar` or `none`.
        classes: (H, W) uint8 Cityscapes training ids, 255 unknown; None where the bag has none.
        depth_single_m: (H, W) float32 depth of the nearest scan alone, NaN unknown; None where `depth_m` is that, or
            it was not asked for.
        scan: How the LiDAR scan nearest to the image was used; None where there is none near it, or none was wanted.
    """

    frame: Frame
    radars: tuple[str, ...]
    depth_m: FloatArray
    source: str
    classes: ImageArray | None = None
    depth_single_m: FloatArray | None = None
    scan: ScanUse | None = None

    @property
    def radar_parts(self) -> tuple[RadarReturns, ...]:
        """The returns of each radar."""
        return self.frame.radar_parts
