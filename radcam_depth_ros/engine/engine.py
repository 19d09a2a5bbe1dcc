"""A network that is ready to run on a device: the one place that decides how it is called."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch import Tensor, nn

from radcam_depth_ros.engine.calls import PlainCalls
from radcam_depth_ros.engine.graphs import CudaGraphs
from radcam_depth_ros.engine.load import allowed_cores, usable_cores
from radcam_depth_ros.engine.memory import give_back_memory, keep_freed_memory
from radcam_depth_ros.engine.onnx_calls import RUNTIMES, OnnxCalls
from radcam_depth_ros.engine.precision import EngineError, NumberFormat, check_precision, choose
from radcam_depth_ros.engine.sharing import ThreadBudget
from radcam_depth_ros.networks import Depths
from radcam_depth_ros.networks.layers.number_formats import convert
from radcam_depth_ros.networks.weights_io import torchscript
from radcam_depth_ros.networks.weights_io.folding import folded
from radcam_depth_ros.networks.weights_io.onnx_file import OnnxNetwork

MODES = ("frozen", "eager")


class Engine:
    """A network on a device, in one number format.

    Frozen: on a CPU batch norms are folded and the network is frozen TorchScript with channels_last weights; on a GPU
    it runs as CUDA graphs. Eager is the reference: the network as it was written, in float32 unless told otherwise. An
    ONNX file runs by onnxruntime.

    Args:
        network: A `Network`, which stays as it is, or that of an export, which runs as it was exported.
        device: `cpu`, `cuda`, `cuda:1` and so on.
        precision: One of `PRECISIONS`; see `precision.choose`.
        mode: One of `MODES`.
        threads: CPU threads; 0 takes as many as other work on the computer leaves cores, at most torch's number.
            onnxruntime has that number from the start to the end.
        runtime: One of `RUNTIMES`: what runs an ONNX file. Other weights know `auto` alone.

    Raises:
        EngineError: when the device is not there, or the network cannot be run as asked.
    """

    def __init__(
        self,
        network: nn.Module,
        device: str | torch.device = "cpu",
        precision: str = "auto",
        mode: str = "frozen",
        threads: int = 0,
        runtime: str = "auto",
    ) -> None:
        for name, value, known in (("mode", mode, MODES), ("runtime", runtime, RUNTIMES)):
            if value not in known:
                raise EngineError(f"{name} must be one of {', '.join(known)}, got {value!r}")
        self._mode = mode
        self._sizes: set[tuple[int, int]] = set()
        self._threads = threads or min(torch.get_num_threads(), usable_cores())
        self._budget: ThreadBudget | None = None
        self._calls: PlainCalls | CudaGraphs | OnnxCalls
        if isinstance(network, OnnxNetwork):
            self._format = _onnx_format(precision, mode)
            self._calls = OnnxCalls(network, runtime, device, self._threads)
            return
        if runtime != "auto":
            raise EngineError(
                f"expected runtime auto for weights that torch runs, got {runtime}; set model_file to an .onnx file of "
                "`radcam-depth export`, or runtime to auto"
            )
        place = _usable(device)
        self._format = _number_format(network, place, precision, mode)
        if place.type == "cpu":
            keep_freed_memory()
        dtype = self._format.dtype
        if mode == "eager":
            reference = convert(copy.deepcopy(network).eval(), dtype).to(place)
            self._calls = PlainCalls(reference, place, dtype, torch.contiguous_format)
        elif place.type == "cuda":
            self._calls = CudaGraphs(folded(network, dtype, place), place, dtype)
        else:
            self._calls = PlainCalls(torchscript.freeze(network, dtype), place, dtype)
            give_back_memory()
        if threads == 0 and self._threads > 1 and place.type == "cpu" and mode == "frozen":
            self._budget = ThreadBudget(self._threads, len(allowed_cores()))

    @property
    def precision(self) -> str:
        """The number format of weights and maps: `float32` or `bfloat16`."""
        return self._format.name

    @property
    def threads(self) -> int:
        """CPU threads, where nothing else runs on the computer."""
        return self._threads

    @property
    def only_size(self) -> tuple[int, int] | None:
        """Height and width of the only image that it runs; None where it runs any."""
        return self._calls.size if isinstance(self._calls, OnnxCalls) else None

    def describe(self) -> str:
        """One line: the number format, why, and how the network is called where that is not the usual way."""
        words = f"{self.precision} ({self._format.reason})"
        if self._mode == "eager":
            return f"{words}, eager"
        return words if isinstance(self._calls, PlainCalls) else f"{words}, {self._calls.describe()}"

    def run(self, image: Tensor, radar: Tensor, ground: Tensor) -> Depths:
        """Estimates the depth of one frame.

        Args:
            image: (H, W, 3) uint8 RGB, contiguous, on the CPU; H and W are multiples of 32.
            radar: (N, 6) float32 on the CPU, columns of `networks.RADAR_COLUMNS`; N may be 0.
            ground: (4,) float32 on the CPU: the flat road, as the network's interface has it.

        Returns:
            On the CPU, float32: `dense` and `confidence` (1, 1, H, W); `semi_dense` (1, 1, h, w) may be smaller by a
            whole factor; and `classes` (1, 1, H, W) uint8 where the network gives them. The memory is the caller's:
            later frames do not write it.
        """
        with self._sharing():
            return self._calls.run(image, radar, ground)

    @contextmanager
    def _sharing(self) -> Iterator[None]:
        """Takes the threads that were asked for, or that the computer has to spare, for one frame."""
        before = torch.get_num_threads()
        torch.set_num_threads(self._budget.begin() if self._budget else self._threads)
        try:
            yield
        finally:
            if self._budget:
                self._budget.end()
            torch.set_num_threads(before)

    def warm_up(self, height: int, width: int) -> None:
        """Makes frames of a size as fast as they will be; at once where that has been done for the size.

        It computes in the calling thread, which is best the one that calls `run`; see `apart` for another.
        """
        if (height, width) not in self._sizes:
            self._calls.warm_up(height, width)
            self._sizes.add((height, width))


def _usable(device: str | torch.device) -> torch.device:
    try:
        place = torch.device(device)
        torch.zeros(1, device=place)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise EngineError(
            f"device {str(device)!r} cannot be used: {reason}; use cpu, or cuda with a CUDA build of torch"
        ) from None
    return place


def _onnx_format(precision: str, mode: str) -> NumberFormat:
    check_precision(precision)
    for name, value, other in (("precision", precision, "bfloat16"), ("mode", mode, "eager")):
        if value == other:
            raise EngineError(
                f"expected {name} other than {other} for an ONNX file, which runs as it was exported, got {other}; "
                "give the .safetensors weights in its place"
            )
    return NumberFormat(torch.float32, "as exported")


def _number_format(network: nn.Module, device: torch.device, precision: str, mode: str) -> NumberFormat:
    check_precision(precision)
    if isinstance(network, torch.jit.ScriptModule):
        if precision == "bfloat16":
            raise EngineError(
                "expected precision auto or float32 for an exported .pt file, which runs as it was exported, got "
                "bfloat16; give the .safetensors weights in its place"
            )
        if device.type != "cpu":
            raise EngineError(
                f"expected device cpu for an exported .pt file, whose weights stay on the CPU, got {device}; "
                "give the .safetensors weights in its place"
            )
        return NumberFormat(torch.float32, "as exported")
    if mode == "eager" and precision == "auto":
        return NumberFormat(torch.float32, "the reference")
    return choose(precision, device)
