"""Frame -> DepthResult: resample to the network's focal length, run, resample back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from radcam_depth_ros.engine import PRECISIONS, Engine
from radcam_depth_ros.frame import CameraModel, DepthResult, FloatArray, Frame, RadarReturns, RadcamDepthError
from radcam_depth_ros.geometry import CanonicalCamera, ground_coefficients, project
from radcam_depth_ros.networks import archive
from radcam_depth_ros.networks.archive import Archive

OUTPUT_SIZES = ("native", "network")


class EstimatorError(RadcamDepthError):
    """A setting of the estimator that cannot be used, or a network that gives nonsense."""


@dataclass(frozen=True)
class EstimatorConfig:
    """How depth is estimated.

    Attributes:
        network: Name of a network whose weights come with the package.
        model_file: A weight file (.safetensors with its card, or an exported .pt) in place of `network`.
        device: `cpu` or `cuda`, or `cuda:1` and so on.
        precision: `float32`, `bfloat16`, or `auto`: whichever the machine is faster in, as a measurement at start says.
        threads: CPU threads of the network; 0 leaves torch's choice.
        output_size: `native` gives depth at the image's size, `network` at the size that the network worked at.
    """

    network: str = "baff"
    model_file: str = ""
    device: str = "cpu"
    precision: str = "auto"
    threads: int = 0
    output_size: str = "native"

    def __post_init__(self) -> None:
        if self.output_size not in OUTPUT_SIZES:
            raise EstimatorError(f"output_size must be one of {', '.join(OUTPUT_SIZES)}, got {self.output_size!r}")
        if self.precision not in PRECISIONS:
            raise EstimatorError(f"precision must be one of {', '.join(PRECISIONS)}, got {self.precision!r}")
        if self.threads < 0:
            raise EstimatorError(f"threads must be 0 (torch's choice) or more, got {self.threads}")


def resample_image(image: Tensor, canonical: CanonicalCamera) -> Tensor:
    """Scales and pads an image for the network.

    Args:
        image: (H, W, 3) uint8 at the size of `canonical.source`.
        canonical: The plan.

    Returns:
        (3, H', W') uint8 at the size of `canonical.network`; the padding repeats the last row and column.
    """
    scaled, network = canonical.scaled, canonical.network
    planes = image.permute(2, 0, 1).unsqueeze(0)
    if (scaled.height, scaled.width) != tuple(planes.shape[2:]):
        planes = functional.interpolate(planes, (scaled.height, scaled.width), mode="bilinear", antialias=True)
    rows = torch.arange(network.height, device=image.device).clamp(max=scaled.height - 1)
    columns = torch.arange(network.width, device=image.device).clamp(max=scaled.width - 1)
    if network.height != scaled.height:
        planes = planes.index_select(2, rows)
    if network.width != scaled.width:
        planes = planes.index_select(3, columns)
    return planes[0]


def radar_columns(radar: RadarReturns, camera: CameraModel, max_depth_m: float) -> FloatArray:
    """The returns that can matter in an image, as a network takes them.

    Args:
        radar: Returns in the camera's frame.
        camera: The camera as the network sees it.
        max_depth_m: Returns beyond this are left out.

    Returns:
        (N, 6) float32, columns of `networks.RADAR_COLUMNS`; returns behind the camera, or farther outside of the image
        than half its width or height, are left out.
    """
    uv, depth = project(radar.xyz_m, camera)
    margin_u, margin_v = 0.5 * camera.width, 0.5 * camera.height
    with np.errstate(invalid="ignore"):
        kept = (depth > 0) & (depth <= max_depth_m)
        kept &= (uv[:, 0] > -margin_u) & (uv[:, 0] < camera.width + margin_u)
        kept &= (uv[:, 1] > -margin_v) & (uv[:, 1] < camera.height + margin_v)
    columns = np.column_stack([uv, depth, radar.rcs_dbsm, radar.radial_speed_mps, radar.age_s])
    return columns[kept].astype(np.float32)


class Estimator:
    """A loaded network that turns frames into depth.

    Args:
        config: What to load and where to run it.
        loaded: A network that is loaded already, in place of the one that `config` names.

    Raises:
        ArchiveError: when the weights cannot be loaded.
        EngineError: when the device is not there, or cannot run the network in the precision that is asked for.
    """

    def __init__(self, config: EstimatorConfig | None = None, loaded: Archive | None = None) -> None:
        self.config = config or EstimatorConfig()
        source = loaded or archive.load(self.config.model_file or self.config.network)
        self.card = source.card
        if self.config.threads:
            torch.set_num_threads(self.config.threads)
        self._engine = Engine(source.network, self.config.device, self.config.precision)
        self._plans: dict[CameraModel, CanonicalCamera] = {}

    def describe(self) -> str:
        """One line: which network, trained on what, running where and in which number format."""
        card = self.card
        return (
            f"{card.network} ({card.training_data}; {card.min_depth_m:g} to {card.max_depth_m:g} m, focal length "
            f"{card.focal_length_px:g} px) on {self.config.device} in {self._engine.describe()}"
        )

    def plan(self, camera: CameraModel) -> CanonicalCamera:
        """How images of a camera are brought to the network; GeometryError when they cannot be."""
        if camera not in self._plans:
            # A vehicle's camera keeps its intrinsics; a zoom must not fill the memory.
            if len(self._plans) > 16:
                self._plans.clear()
            self._plans[camera] = CanonicalCamera.plan(camera, self.card.focal_length_px)
        return self._plans[camera]

    def warm_up(self, camera: CameraModel) -> None:
        """Makes the network ready for a camera's images, if it is not: its first frames are then as fast as others."""
        network = self.plan(camera).network
        self._engine.warm_up(network.height, network.width)

    def estimate(self, frame: Frame) -> DepthResult:
        """Estimates the depth of a frame.

        Raises:
            GeometryError: when the camera's image cannot be brought to the network's focal length.
            EstimatorError: when the network's depth is not finite.
        """
        plan = self.plan(frame.camera)
        columns = radar_columns(frame.radar, plan.network, self.card.max_depth_m)
        with torch.inference_mode():
            image = resample_image(torch.from_numpy(np.require(frame.image, requirements=["C", "W"])), plan)
            dense, semi_dense, confidence = self._engine.run(
                image.permute(1, 2, 0).contiguous(),
                torch.from_numpy(columns),
                torch.from_numpy(ground_coefficients(frame.ground, plan.network)),
            )
            if not bool(torch.isfinite(dense).all()):
                raise EstimatorError("the network gave a depth that is not finite; its weights do not fit these inputs")
            camera = plan.scaled if self.config.output_size == "network" else plan.source
            return DepthResult(
                frame.stamp_ns,
                frame.frame_id,
                camera,
                _resample_back(dense, plan, camera, "bilinear"),
                _resample_back(semi_dense, plan, camera, "nearest-exact"),
                _resample_back(confidence, plan, camera, "bilinear"),
                len(columns),
            )


def _resample_back(maps: Tensor, plan: CanonicalCamera, camera: CameraModel, mode: str) -> FloatArray:
    cropped = maps[:, :, : plan.scaled.height, : plan.scaled.width].float()
    if (camera.height, camera.width) != tuple(cropped.shape[2:]):
        cropped = functional.interpolate(cropped, (camera.height, camera.width), mode=mode)
    result: FloatArray = cropped[0, 0].contiguous().cpu().numpy()
    return result
