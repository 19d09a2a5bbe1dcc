"""Depth images and their camera_info as depth_image_proc reads them: its points are those of the simulated world."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import torch
from torch import Tensor, nn

from radcam_depth_ros import simulation
from radcam_depth_ros.bags import factory
from radcam_depth_ros.encoder import OUTPUTS, Encoder, OutputConfig
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.frame import CameraModel, DepthResult, Frame, RadarReturns
from radcam_depth_ros.frame_builder import FrameBuilder, FrameBuilderConfig
from radcam_depth_ros.geometry import CanonicalCamera, RigidTransform
from radcam_depth_ros.messages import DEPTH_ENCODINGS, decode_points
from radcam_depth_ros.networks import Depths
from radcam_depth_ros.networks.weights_io.archive import Archive, Card
from radcam_depth_ros.pipeline import Pipeline
from radcam_depth_ros.simulation.objects.scene import Scene
from radcam_depth_ros.simulation.recording import SimulatedDrive
from radcam_depth_ros.simulation.sensors import rig

FOCAL = 315.0
FAR_M = 400.0
WORLD = simulation.WorldConfig(street=simulation.StreetKind.TOWN, view_m=100.0)
CAMERAS = {
    "as the network": CameraModel(400, 224, FOCAL, FOCAL, 197.3, 113.8),
    "longer lens": CameraModel(481, 270, 612.0, 598.5, 251.7, 120.2),
    "wider lens": CameraModel(250, 160, 201.4, 203.9, 119.4, 83.1),
}


@dataclass(frozen=True)
class Sight:
    """A place in the simulated world from which it is looked at."""

    scene: Scene
    world_from_camera: RigidTransform

    def points(self, camera: CameraModel) -> npt.NDArray[np.float32]:
        """(H, W, 3) metres in the camera's axes: what each pixel's ray meets, NaN in the sky."""
        v, u = np.mgrid[: camera.height, : camera.width].astype(np.float64)
        rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], axis=-1)
        directions = (rays.reshape(-1, 3) @ self.world_from_camera.rotation.T).astype(np.float32)
        origin = self.world_from_camera.translation.astype(np.float32)
        hits = self.scene.cast(np.tile(origin, (len(directions), 1)), directions)
        distance = np.where(hits.face >= 0, hits.distance_m, np.nan)[:, None]
        met = self.world_from_camera.inverse().apply(origin + distance * directions)
        return met.reshape(camera.height, camera.width, 3)


class GivesDepth(nn.Module):
    """The depth that it was made with."""

    def __init__(self, depth: npt.NDArray[np.float32]) -> None:
        super().__init__()
        self.register_buffer("depth", torch.from_numpy(depth)[None, None])

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        return Depths(self.depth, self.depth, torch.ones_like(self.depth))


@pytest.fixture(scope="module")
def sight() -> Sight:
    drive = SimulatedDrive(simulation.SimulationConfig(world=WORLD), seed=4, frames=1)
    world_from_camera = drive.world.ego.motion(1.0).world_from_base @ drive.rig.footprint_from(rig.CAMERA)
    return Sight(drive.world.scene_at(1.0), world_from_camera)


def point_cloud_xyz(depth: Any, info: Any) -> npt.NDArray[np.float64]:
    """What the node point_cloud_xyz of depth_image_proc makes of a depth image and its camera_info: (H, W, 3) metres.

    Its camera is that of P; 16UC1 is millimetres with 0 for no value, 32FC1 metres with NaN.
    """
    assert (info.width, info.height) == (depth.width, depth.height)
    if depth.encoding == "16UC1":
        raw = np.frombuffer(depth.data, np.uint16).astype(np.float64)
        z = np.where(raw != 0, raw * 0.001, np.nan)
    else:
        assert depth.encoding == "32FC1"
        raw = np.frombuffer(depth.data, np.float32).astype(np.float64)
        z = np.where(np.isfinite(raw), raw, np.nan)
    z = z.reshape(depth.height, depth.step // (2 if depth.encoding == "16UC1" else 4))[:, : depth.width]
    fx, fy, cx, cy = info.p[0], info.p[5], info.p[2], info.p[6]
    v, u = np.mgrid[: depth.height, : depth.width]
    return np.stack([(u - cx) * z / fx, (v - cy) * z / fy, z], axis=-1)


def compare(messages: dict[str, Any], truth: npt.NDArray[np.float32]) -> None:
    is_seen = truth[..., 2] < (65.0 if messages["depth"].encoding == "16UC1" else FAR_M)
    assert is_seen.mean() > 0.4
    for depth, info in (
        (messages["depth"], messages["depth_camera_info"]),
        (messages["semi_dense"], messages["semi_dense_camera_info"]),
    ):
        points = point_cloud_xyz(depth, info)
        assert points.shape == truth.shape
        off = np.linalg.norm(points - truth, axis=-1) / np.linalg.norm(truth, axis=-1)
        assert off[is_seen].max() < 0.01
    cloud = decode_points(messages["points"]).xyz_m
    np.testing.assert_allclose(cloud, truth[truth[..., 2] < FAR_M], rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_its_points_are_those_of_the_world(sight: Sight, camera: CameraModel) -> None:
    plan = CanonicalCamera.plan(camera, FOCAL)
    exact = sight.points(plan.network)[..., 2]
    network = GivesDepth(np.where(np.isfinite(exact), exact, np.float32(FAR_M + 100)).astype(np.float32))
    estimator = Estimator(
        EstimatorConfig(precision="float32", output_size="network"),
        Archive(network, Card("test", {}, FOCAL, 1.0, 100.0, "nothing")),
    )
    config, output = FrameBuilderConfig(), OutputConfig(points_far_m=FAR_M)
    pipeline = Pipeline(FrameBuilder(config), estimator, Encoder(output, factory))
    frame = Frame(5, "camera", np.zeros((camera.height, camera.width, 3), np.uint8), camera, RadarReturns.empty())
    native = sight.points(camera)
    for encoding in DEPTH_ENCODINGS:
        pipeline.adjust(config, estimator.config, replace(output, depth_encoding=encoding))
        found = pipeline.estimate(frame, OUTPUTS)
        assert found is not None
        messages = pipeline.encode(frame, found, OUTPUTS)
        assert messages["depth_camera_info"].width == plan.scaled.width
        compare(messages, sight.points(plan.scaled))

        depth = np.ascontiguousarray(native[..., 2])
        result = DepthResult(5, "camera", camera, depth, depth, np.ones_like(depth), 0)
        compare(pipeline.encode(frame, result, OUTPUTS), native)
