"""Many LiDAR scans as one depth image (METHODS, ground truth: d_acc).

Scans before and after an image are moved to its time by the vehicle's motion. Left out is what moved, what the scan of
the image's time contradicts, and what shows through the gaps between nearer points. Where several points fall on a
pixel the nearest wins.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.bags.topics import SensorTopics
from radcam_depth_ros.drive.range_view import Tolerance, Verdict
from radcam_depth_ros.drive.scans import Scan, ScanWindow
from radcam_depth_ros.drive.settings import AccumulationConfig, DriveError
from radcam_depth_ros.frame import CameraModel, FloatArray, Frame
from radcam_depth_ros.geometry import RigidTransform, TransformTree, depth_image
from radcam_depth_ros.motion import Motion

_OCCLUSION_FOCAL_LENGTH_PX = 630.0
_NEAREST_M = 0.5


@dataclass(frozen=True)
class LidarDepth:
    """What a LiDAR tells of an image's depth.

    Attributes:
        single_m: (H, W) float32 metres, NaN unknown: the nearest scan, moved to the image's time.
        accumulated_m: The same of all scans around it; None where nobody asked.
    """

    single_m: FloatArray
    accumulated_m: FloatArray | None


class Accumulator:
    """Gives the LiDAR's depth of one image after another.

    Args:
        reader: The bag, for this alone: it is read ahead of the images.
        topics: Its topics; with a LiDAR.
        transforms: The vehicle's fixed frames.
        config: How.
    """

    def __init__(
        self, reader: BagReader, topics: SensorTopics, transforms: TransformTree, config: AccumulationConfig
    ) -> None:
        self._reader, self._topics, self._transforms, self._config = reader, topics, transforms, config
        self._motion: Motion | None = None
        self._window: ScanWindow | None = None

    def depth(self, frame: Frame, max_offset_ns: int, *, single: bool) -> LidarDepth | None:
        """The depth of a frame; None where no scan is near enough, or nobody knows where the vehicle was.

        Args:
            frame: The frame.
            max_offset_ns: The farthest that the nearest scan may lie from it in time.
            single: The nearest scan alone is wanted.

        Raises:
            DriveError: when the bag does not tell how the vehicle moved.
            GeometryError: when a transform between camera, LiDAR and vehicle is missing.
        """
        motion, window = self._start(frame.frame_id)
        scans = window.around(frame.stamp_ns)
        if motion.base_frame is None:
            raise DriveError(
                f"{motion.topic} has no pose of a frame that {frame.frame_id!r} is fixed to; record odometry "
                "(nav_msgs/Odometry), or the link from odom to the vehicle on /tf"
            )
        pose = motion.at(frame.stamp_ns)
        nearest = min(scans, key=lambda scan: abs(scan.stamp_ns - frame.stamp_ns), default=None)
        if pose is None or nearest is None or abs(nearest.stamp_ns - frame.stamp_ns) > max_offset_ns:
            return None
        world_from_camera = pose @ self._transforms.lookup(motion.base_frame, frame.frame_id)
        moved = (world_from_camera.inverse() @ nearest.world_from_scan).apply(nearest.points_m)
        many = None if single else accumulate(nearest, scans, world_from_camera, frame.camera, self._config)
        return LidarDepth(depth_image(moved, frame.camera), many)

    def _start(self, camera_frame: str) -> tuple[Motion, ScanWindow]:
        if self._motion is None or self._window is None:
            lidar, topic = self._topics.lidar, self._topics.odometry or self._topics.tf
            if lidar is None or topic is None:
                raise DriveError(
                    "it does not say how the vehicle moved; record odometry (nav_msgs/Odometry), or the link from "
                    "odom to the vehicle on /tf"
                )
            self._motion = Motion(
                topic,
                is_odometry=self._topics.odometry is not None,
                transforms=self._transforms,
                anchor=camera_frame,
            )
            messages = self._reader.messages([lidar, topic])
            self._window = ScanWindow(messages, lidar, self._motion, self._transforms, self._config)
        return self._motion, self._window


def accumulate(
    nearest: Scan,
    scans: tuple[Scan, ...],
    world_from_camera: RigidTransform,
    camera: CameraModel,
    config: AccumulationConfig,
) -> FloatArray:
    """The depth image of many scans.

    Args:
        nearest: The scan nearest to the image, which says what is there at the image's time.
        scans: All scans around it, `nearest` too.
        world_from_camera: The camera's place at the image's time.
        camera: The camera.
        config: How.

    Returns:
        (H, W) float32 metres, NaN unknown.
    """
    tolerance = Tolerance(config.tolerance_m, config.tolerance_share)
    camera_from_world = world_from_camera.inverse()
    nearest_from_camera = nearest.world_from_scan.inverse() @ world_from_camera
    parts = [(camera_from_world @ nearest.world_from_scan).apply(nearest.points_m)]
    for scan in scans:
        camera_from_scan = camera_from_world @ scan.world_from_scan
        if scan is nearest or np.linalg.norm(camera_from_scan.translation) > config.window_m:
            continue
        points_m = _in_view(camera_from_scan.apply(scan.standing_m(scans, tolerance)), camera)
        verdict = nearest.view.judge(nearest_from_camera.apply(points_m), tolerance)
        parts.append(points_m[(verdict != Verdict.SEEN_THROUGH) & (verdict != Verdict.HIDDEN)])
    return without_occluded(depth_image(np.concatenate(parts), camera), camera, config)


def without_occluded(depth_m: FloatArray, camera: CameraModel, config: AccumulationConfig) -> FloatArray:
    """Takes out pixels that show through the gaps of something nearer.

    Those have clearly nearer pixels on both sides, above and below or left and right. Nearer on one side alone is what
    a road has below it, and a wall beside a pole.
    """
    reach = config.occlusion_px * camera.fx / _OCCLUSION_FOCAL_LENGTH_PX
    rows, columns, aside = max(1, round(reach)), max(1, round(reach / 2)), max(1, round(reach / 8))
    known = np.where(np.isnan(depth_m), np.float32(np.inf), depth_m)
    in_front = (1 - 2 * config.tolerance_share) * known - 2 * config.tolerance_m
    # An erosion that is anchored at an end takes the minimum on one side. Beams lie closer beside one another than one
    # above the other, and a road is nearer in the row below: columns may be some pixels wide, rows may not.
    tall, wide = np.ones((rows + 1, 2 * aside + 1), np.uint8), np.ones((1, columns + 1), np.uint8)
    above, below = _minimum(known, tall, (aside, rows)), _minimum(known, tall, (aside, 0))
    left, right = _minimum(known, wide, (columns, 0)), _minimum(known, wide, (0, 0))
    behind = ((above < in_front) & (below < in_front)) | ((left < in_front) & (right < in_front))
    result = depth_m.copy()
    result[behind] = np.nan
    return result


def _minimum(values: FloatArray, kernel: np.ndarray, anchor: tuple[int, int]) -> FloatArray:
    return np.asarray(
        cv2.erode(values, kernel, anchor=anchor, borderType=cv2.BORDER_CONSTANT, borderValue=np.inf), np.float32
    )


def _in_view(points_m: FloatArray, camera: CameraModel) -> FloatArray:
    """The points (N, 3) in camera axes that fall on the image, or near enough to round to it."""
    x, y, z = points_m[:, 0], points_m[:, 1], points_m[:, 2]
    left, right = -(camera.cx + 1) / camera.fx, (camera.width - camera.cx) / camera.fx
    top, bottom = -(camera.cy + 1) / camera.fy, (camera.height - camera.cy) / camera.fy
    inside = (z > _NEAREST_M) & (x > left * z) & (x < right * z) & (y > top * z) & (y < bottom * z)
    return points_m[inside]
