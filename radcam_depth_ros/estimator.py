"""Estimates a frame's depth: resample to the network's focal length, run it, resample back."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch

from radcam_depth_ros.engine import PRECISIONS, RUNTIMES, Engine, apart
from radcam_depth_ros.frame import (
    CameraModel,
    DepthResult,
    FloatArray,
    Frame,
    ImageArray,
    RadarReturns,
    RadcamDepthError,
)
from radcam_depth_ros.geometry import CanonicalCamera, ground_coefficients, project
from radcam_depth_ros.networks import Depths
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.networks.weights_io.archive import Archive, Card
from radcam_depth_ros.resampling import enlarge_nearest, enlarge_smooth, resample_image, use_one_thread
from radcam_depth_ros.setting import can_adjust, check_choices, live_settings, setting

OUTPUT_SIZES = ("native", "network")


class EstimatorError(RadcamDepthError):
    """A setting of the estimator that cannot be used, or a network that gives nonsense."""


@dataclass(frozen=True)
class EstimatorConfig:
    """How depth is estimated."""

    network: str = setting("baff", "Network whose weights come with the package.")
    model_file: str = setting(
        "",
        "Weight file in place of the network's own. It is a .safetensors file, or a .pt or .onnx file "
        "of radcam-depth export, for which allow_exported must be true.",
    )
    allow_exported: bool = setting(
        False,
        "Whether model_file may be an exported file. Its code, which is checked before, runs in the node; a "
        ".safetensors file has none.",
    )
    trusted_models: tuple[str, ...] = setting(
        (), "SHA-256 of the weight files that may be loaded, 64 hexadecimal digits each. Empty allows any file."
    )
    device: str = setting("cpu", "Device that runs the network: cpu, cuda, cuda:1 and so on.")
    precision: str = setting(
        "auto",
        "Number format of the network. auto takes the environment variable RADCAM_DEPTH_PRECISION, else what suits the "
        "processor; the log and the diagnostics say which format it is, and why.",
        choices=PRECISIONS,
    )
    runtime: str = setting(
        "auto",
        "What onnxruntime runs an .onnx file on. auto takes cuda where device is cuda, else cpu; tensorrt leaves to "
        "CUDA what TensorRT cannot do. Other weights need auto.",
        choices=RUNTIMES,
    )
    threads: int = setting(
        0, "CPU threads of the network. 0 takes as many as other work on the computer leaves cores.", 0, 256
    )
    output_size: str = setting(
        "native",
        "Size of the depth images. native is the image's size, network the size that the network works at, with a "
        "camera_info of its own.",
        choices=OUTPUT_SIZES,
        live=True,
    )

    def __post_init__(self) -> None:
        check_choices(self, EstimatorError)
        for entry in self.trusted_models:
            if not re.fullmatch("[0-9a-fA-F]{64}", entry):
                raise EstimatorError(f"trusted_models must hold SHA-256 of 64 hexadecimal digits, got {entry[:80]!r}")
        if self.threads < 0:
            raise EstimatorError(f"threads must be 0 (as many as are free) or more, got {self.threads}")


@dataclass(frozen=True)
class Computation:
    """What the digits of a depth image follow from: vehicles of a fleet that have the same compute the same.

    Attributes:
        precision: The number format of the network: `float32` or `bfloat16`.
        threads: CPU threads of the network, where nothing else runs on the computer.
        weights_sha256: SHA-256 of the weight file, as `sha256sum` prints it; empty for a network of no file.
    """

    precision: str
    threads: int
    weights_sha256: str

    def values(self) -> tuple[tuple[str, str], ...]:
        """Names and values, as diagnostics show them."""
        return (
            ("number format", self.precision),
            ("threads", str(self.threads)),
            ("SHA-256 of the weight file", self.weights_sha256 or "none: the network is of no file"),
        )


@dataclass(frozen=True)
class NetworkInputs:
    """A frame as the network takes it.

    Attributes:
        frame: What it was made from.
        plan: How the frame's camera is brought to the network.
        image: (H, W, 3) uint8 RGB, contiguous, at the size of `plan.network`.
        radar: (N, 6) float32, columns of `networks.RADAR_COLUMNS`.
        ground: (4,) float32, see `geometry.ground_coefficients`.
    """

    frame: Frame
    plan: CanonicalCamera
    image: ImageArray
    radar: FloatArray
    ground: FloatArray


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


def _load(config: EstimatorConfig, loaded: Archive | None) -> tuple[Card, Engine, str]:
    name = config.model_file or config.network
    source = loaded or archive.load(name, allow_exported=config.allow_exported, trusted=config.trusted_models)
    engine = Engine(source.network, config.device, config.precision, threads=config.threads, runtime=config.runtime)
    return source.card, engine, source.file_sha256


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
        use_one_thread()
        if self.config.threads:
            torch.set_num_threads(self.config.threads)
        self.card, self._engine, self._weights_sha256 = apart(partial(_load, self.config, loaded))
        self._plans: dict[CameraModel, CanonicalCamera] = {}

    def can_adjust(self, config: EstimatorConfig) -> bool:
        """Whether this network, as it is loaded, serves another config; else one must be loaded for it."""
        return can_adjust(self.config, config)

    def adjust(self, config: EstimatorConfig) -> None:
        """Takes up a config that differs in live settings, from the next frame that is finished on.

        Raises:
            EstimatorError: when another network would have to be loaded.
        """
        if not self.can_adjust(config):
            names = ", ".join(live_settings(config))
            raise EstimatorError(f"only {names} can change while a network is loaded; load it anew")
        self.config = config

    def describe(self) -> str:
        """One line: which network, trained on what, running where and in which number format."""
        card = self.card
        return (
            f"{card.network} ({card.training_data}; {card.min_depth_m:g} to {card.max_depth_m:g} m, focal length "
            f"{card.focal_length_px:g} px) on {self.config.device} in {self._engine.describe()}"
        )

    @property
    def computation(self) -> Computation:
        """What the digits of its depth follow from."""
        return Computation(self._engine.precision, self._engine.threads, self._weights_sha256)

    @property
    def tells_classes(self) -> bool:
        """Whether the network gives a class image."""
        return self.card.tells_classes

    @property
    def only_size(self) -> tuple[int, int] | None:
        """Height and width of the only image that the network takes; None of one that takes any."""
        return self._engine.only_size

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

    def estimate(self, frame: Frame, *, classes: bool = True) -> DepthResult:
        """Estimates the depth of a frame: `prepare`, `run` and `finish`, which may also run in a thread each.

        Args:
            frame: The frame.
            classes: Whether the class image is wanted, where the network gives one.

        Raises:
            GeometryError: when the camera's image cannot be brought to the network's focal length.
            EstimatorError: when the network's depth is not finite.
        """
        inputs = self.prepare(frame)
        return self.finish(inputs, self.run(inputs), classes=classes)

    def prepare(self, frame: Frame) -> NetworkInputs:
        """Brings a frame to the network's focal length.

        Raises:
            GeometryError: when that cannot be.
        """
        plan = self.plan(frame.camera)
        return NetworkInputs(
            frame,
            plan,
            resample_image(frame.image, plan, frame.lens),
            radar_columns(frame.radar, plan.network, self.card.max_depth_m),
            ground_coefficients(frame.ground.or_assumed(), plan.network),
        )

    def run(self, inputs: NetworkInputs) -> Depths:
        """Runs the network; each map (1, 1, h, w) float32 on the CPU, of the network's size or smaller by a factor."""
        with torch.inference_mode():
            arrays = (inputs.image, inputs.radar, inputs.ground)
            return self._engine.run(*(torch.from_numpy(values) for values in arrays))

    def finish(self, inputs: NetworkInputs, depths: Depths, *, classes: bool = True) -> DepthResult:
        """Brings the network's maps to the size that is asked for.

        Args:
            inputs: Of the frame.
            depths: What the network made of them.
            classes: As in `estimate`.

        Raises:
            EstimatorError: when the network's depth is not finite.
        """
        frame, plan = inputs.frame, inputs.plan
        dense, semi_dense, confidence = (
            values[0, 0].numpy() for values in (depths.dense, depths.semi_dense, depths.confidence)
        )
        # At the network's size: what is made of finite values between them is finite as well.
        if not np.isfinite(dense).all():
            raise EstimatorError("the network gave a depth that is not finite; its weights do not fit these inputs")
        camera = plan.scaled if self.config.output_size == "network" else plan.source
        class_map = depths.classes if classes else None
        return DepthResult(
            frame.stamp_ns,
            frame.frame_id,
            camera,
            enlarge_smooth(dense, plan, camera),
            enlarge_nearest(semi_dense, plan, camera),
            enlarge_smooth(confidence, plan, camera),
            len(inputs.radar),
            None if class_map is None else enlarge_nearest(class_map[0, 0].numpy(), plan, camera),
            None if depths.sky is None else enlarge_smooth(depths.sky[0, 0].numpy(), plan, camera),
        )
