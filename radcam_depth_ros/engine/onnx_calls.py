"""Runs an exported ONNX file by onnxruntime, on the CPU, CUDA or TensorRT."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from radcam_depth_ros.engine.calls import blank_frame
from radcam_depth_ros.engine.graphs import WARM_UP_RETURNS, padded_count
from radcam_depth_ros.engine.precision import EngineError
from radcam_depth_ros.networks import Depths
from radcam_depth_ros.networks.weights_io.onnx_file import INPUTS, OnnxNetwork, open_session

RUNTIMES = ("auto", "cpu", "cuda", "tensorrt")
_PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider", "tensorrt": "TensorrtExecutionProvider"}
_REMEDY = (
    "install an onnxruntime that has it (onnxruntime-gpu, or the one of your Jetson's JetPack), or set runtime to cpu"
)


class OnnxCalls:
    """Runs an ONNX file.

    On a GPU the returns are padded to the next power of two: TensorRT builds anew for each shape that it has not seen.

    Args:
        network: The file.
        runtime: One of `RUNTIMES`; auto takes cuda for a device of that name, cpu for others.
        device: `cpu`, or the GPU by its number, such as `cuda:1`; the first where it is not told.
        threads: Of onnxruntime, on the CPU; they stay as many.

    Attributes:
        runtime: What it runs on: `cpu`, `cuda` or `tensorrt`.
        size: Height and width of the image that the file takes.

    Raises:
        EngineError: when the provider is not there, or cannot run the file.
    """

    def __init__(self, network: OnnxNetwork, runtime: str, device: str | torch.device, threads: int) -> None:
        import onnxruntime

        place = _device(device)
        self.runtime = ("cpu" if place.type == "cpu" else "cuda") if runtime == "auto" else runtime
        wanted, there = _PROVIDERS[self.runtime], onnxruntime.get_available_providers()
        if wanted not in there:
            raise EngineError(
                f"runtime {self.runtime} needs onnxruntime's {wanted}, and the one that is installed has "
                f"{', '.join(there)}; {_REMEDY}"
            )
        try:
            self._session = open_session(network, _chain(self.runtime, place.index or 0), threads)
        except Exception as error:  # onnxruntime's exceptions have no base of their own
            raise EngineError(
                f"onnxruntime cannot run the ONNX file on {self.runtime}: {_line(error)}; make it anew with "
                "`radcam-depth export`, or try runtime cpu"
            ) from error
        if wanted not in self._session.get_providers():
            # onnxruntime goes on without a provider whose libraries cannot be loaded, and says so on stderr alone.
            raise EngineError(f"onnxruntime's {wanted} could not be started here; {_REMEDY}")
        self._session.disable_fallback()
        self.size = (network.height, network.width)
        self._outputs = network.outputs
        self._version = str(onnxruntime.__version__)

    def describe(self) -> str:
        """How the network is called, in a few words."""
        return f"onnxruntime {self._version} on {self.runtime}"

    def run(self, image: Tensor, radar: Tensor, ground: Tensor) -> Depths:
        """As `Engine.run`; EngineError for an image of another size than the file's."""
        size = (image.shape[0], image.shape[1])
        if size != self.size:
            raise EngineError(
                f"expected an image of {self.size[0]} x {self.size[1]} pixels at the network's focal length, for which "
                f"the ONNX file was made, got {size[0]} x {size[1]}; make one with `radcam-depth export --size "
                f"{size[0]}x{size[1]}`"
            )
        rows = radar.numpy()
        if self.runtime != "cpu":
            # Rows of zeros: a depth of 0 is padding.
            rows = np.pad(rows, ((0, padded_count(len(rows)) - len(rows)), (0, 0)))
        given = dict(zip(INPUTS, (image.numpy(), rows, ground.numpy()), strict=True))
        try:
            maps: list[Any] = self._session.run(None, given)
        except Exception as error:  # as above
            raise EngineError(f"onnxruntime failed on {self.runtime}: {_line(error)}; try runtime cpu") from error
        return Depths(**{name: torch.from_numpy(values) for name, values in zip(self._outputs, maps, strict=True)})

    def warm_up(self, height: int, width: int) -> None:
        """Runs frames of that size until the next one is as fast as those after it."""
        for returns in WARM_UP_RETURNS[: 1 if self.runtime == "cpu" else None]:
            self.run(*blank_frame(height, width, returns))


def _device(device: str | torch.device) -> torch.device:
    """Which device is meant, whether or not torch can use it; EngineError for none that onnxruntime is asked for."""
    try:
        place = torch.device(device)
    except RuntimeError:
        place = torch.device("meta")
    if place.type not in ("cpu", "cuda"):
        raise EngineError(f"expected device cpu or cuda for an ONNX file, got {str(device)!r}; choose one of them")
    return place


def _chain(runtime: str, index: int) -> list[Any]:
    """Providers in the order in which onnxruntime asks them: what one cannot do, the next one does."""
    on_gpu = {"device_id": index}
    first = {"cpu": [], "cuda": ["cuda"], "tensorrt": ["tensorrt", "cuda"]}[runtime]
    return [*((_PROVIDERS[name], on_gpu) for name in first), _PROVIDERS["cpu"]]


def _line(error: Exception) -> str:
    """The first line of what onnxruntime says."""
    return (str(error).splitlines() or [type(error).__name__])[0][:300]
