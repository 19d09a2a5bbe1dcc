"""Frame -> DepthResult: resample to the network's focal length, run, resample back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from radcam_depth_ros.engine import Engine
from radcam_depth_ros.frame import CameraModel, DepthResult, FloatArray, Frame, RadarReturns, RadcamDepthError
from radcam_depth_ros.geometry import CanonicalCamera, ground_coefficients, project
from radcam_depth_ros.networks import archive
from radcam_depth_ros.networks.archive import Archive

OUTPUT_SIZES = ("native", "network")


class EstimatorError(RadcamDepthError):
    """A setting of the estimator that cannot be used on this machine, or a network that gives nonsense."""


@dataclass(frozen=True)
class EstimatorConfig:
    """How depth is estimated.

    Attributes:
        network: Name of a network whose weights come with the package.
        model_file: A weight file (.safetensors with its card, or an exported .pt) in place of `network`.
        device: `cpu` or `cuda`, or `cuda:1` and so on.
        threads: CPU threads of the network; 0 leaves torch's choice.
        output_size: `native` gives depth at the image's size, `network` at the size that the network worked at.
        precision: `auto`, `float32` or `bfloat16`.
    """

    network: str = "baff"
    model_file: str = ""
    device: str = "cpu"
    threads: int = 0
    output_size: str = "native"
    precision: str = "auto"

    def __post_init__(self) -> None:
        if self.output_size not in OUTPUT_SIZES:
            raise EstimatorError(f"output_size must be one of {', '.join(OUTPUT_SIZES)}, got {self.output_size!r}")
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
        EstimatorError: when the device is not there.
    """

    def __init__(self, config: EstimatorConfig | None = None, loaded: Archive | None = None) -> None:
        self.config = config or EstimatorConfig()
        try:
            self._device = torch.device(self.config.device)
            torch.zeros(1, device=self._device)
        except (RuntimeError, AssertionError) as error:
            reason = str(error).splitlines()[0]
            raise EstimatorError(
                f"device {self.config.device!r} cannot be used: {reason}; use cpu, or cuda with a CUDA build of torch"
            ) from None
        source = loaded or archive.load(self.config.model_file or self.config.network)
        self.card = source.card
        if self.config.threads:
            torch.set_num_threads(self.config.threads)
        engine = Engine(source.network, self._device, self.config.precision)
        self._network, self._dtype = engine.network, getattr(torch, engine.precision)
        self._plans: dict[CameraModel, CanonicalCamera] = {}

    def describe(self) -> str:
        """One line: which network, trained on what, running where."""
        card = self.card
        return (
            f"{card.network} ({card.training_data}; {card.min_depth_m:g} to {card.max_depth_m:g} m, focal length "
            f"{card.focal_length_px:g} px) on {self._device}"
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
        """Runs the network for a camera's size until TorchScript has specialised it."""
        image = np.zeros((camera.height, camera.width, 3), np.uint8)
        frame = Frame(0, "warm_up", image, camera, RadarReturns.from_points(np.array([[0.0, 0.0, 10.0]])))
        # TorchScript profiles the first call and optimises in the second.
        for _ in range(3):
            self.estimate(frame)

    def estimate(self, frame: Frame) -> DepthResult:
        """Estimates the depth of a frame.

        Raises:
            GeometryError: when the camera's image cannot be brought to the network's focal length.
            EstimatorError: when the network's depth is not finite.
        """
        plan = self.plan(frame.camera)
        columns = radar_columns(frame.radar, plan.network, self.card.max_depth_m)
        with torch.inference_mode():
            image = resample_image(
                torch.from_numpy(np.require(frame.image, requirements=["C", "W"])).to(self._device), plan
            )
            pixels = image.unsqueeze(0).contiguous(memory_format=torch.channels_last).to(self._dtype) / 255.0
            radar = torch.from_numpy(columns).to(self._device).unsqueeze(0)
            valid = torch.ones(radar.shape[:2], dtype=torch.bool, device=self._device)
            ground = torch.from_numpy(ground_coefficients(frame.ground, plan.network)).to(self._device).unsqueeze(0)
            dense, semi_dense, confidence = self._network(pixels, radar, valid, ground)
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
