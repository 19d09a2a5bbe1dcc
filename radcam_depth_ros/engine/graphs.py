"""Runs a network as CUDA graphs: one call starts all its kernels.

Not yet run on a GPU: written on machines without one, and tested there as far as that goes.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from radcam_depth_ros.engine.calls import PlainCalls, blank_frame, each, forward
from radcam_depth_ros.networks import Depths

MIN_RETURNS = 64
WARM_UP_RETURNS = (64, 128, 256, 512, 1024)
"""Sizes of the radar input that are captured before they come; larger ones are when they come."""

RUNS_BEFORE_CAPTURE = 3
"""Libraries choose kernels and allocate in their first calls, which a capture does not allow."""


def padded_count(returns: int) -> int:
    """Rows of the radar input for so many returns: the next power of two, 64 or more; each has a graph of its own."""
    return max(MIN_RETURNS, 1 << (returns - 1).bit_length()) if returns else MIN_RETURNS


class Inputs:
    """One frame's inputs, at one size: where the host writes them, and where a graph reads them.

    Args:
        height: Rows of the image.
        width: Columns of the image.
        count: Rows of the radar input.
        device: Where the graph reads; for a GPU the host's side is pinned, so that copies need not be waited for.
    """

    def __init__(self, height: int, width: int, count: int, device: torch.device) -> None:
        pinned = device.type == "cuda"
        self.host = (
            torch.zeros(height, width, 3, dtype=torch.uint8, pin_memory=pinned),
            torch.zeros(count, 6, pin_memory=pinned),
            torch.zeros(count, dtype=torch.bool, pin_memory=pinned),
            torch.zeros(4, pin_memory=pinned),
        )
        image, radar, valid, ground = (torch.zeros_like(tensor, device=device) for tensor in self.host)
        self.device = (image, radar, valid, ground)

    def fill(self, image: Tensor, radar: Tensor, ground: Tensor) -> None:
        """Writes a frame on the host: image (H, W, 3) uint8, radar (N, 6) with N <= count, ground (4,)."""
        host_image, host_radar, host_valid, host_ground = self.host
        host_image.copy_(image)
        host_radar[: len(radar)] = radar
        # Rows that are no returns still go through the network: no NaN, no depth of 0.
        host_radar[len(radar) :] = 1.0
        host_valid[: len(radar)] = True
        host_valid[len(radar) :] = False
        host_ground.copy_(ground)

    def upload(self) -> None:
        """Starts the copies to the device, in the stream that is current."""
        for target, source in zip(self.device, self.host, strict=True):
            target.copy_(source, non_blocking=True)


@dataclass(frozen=True)
class Captured:
    """A graph with the memory that it reads and writes.

    Attributes:
        inputs: What it reads.
        graph: The graph.
        outputs: What it writes: each replay writes the same tensors anew.
        copies: The stream of the copies to and from the device.
    """

    inputs: Inputs
    graph: torch.cuda.CUDAGraph
    outputs: Depths
    copies: torch.cuda.Stream


class CudaGraphs:
    """Runs a network as one CUDA graph for each height, width and padded number of returns.

    Where a capture fails, the network is called as it is, from then on, and `failure` says why.

    Args:
        network: Its weights are in `dtype` and on `device`.
        device: A GPU.
        dtype: What it computes in.
    """

    def __init__(self, network: nn.Module, device: torch.device, dtype: torch.dtype) -> None:
        self._network = network
        self._device = device
        self._dtype = dtype
        self._plain = PlainCalls(network, device, dtype)
        self._captured: dict[tuple[int, int, int], Captured] = {}
        self.failure = ""
        """Why graphs could not be captured; empty while they can."""

    def describe(self) -> str:
        """How the network is called, in a few words."""
        return f"plain calls, since no CUDA graph could be captured: {self.failure}" if self.failure else "CUDA graphs"

    def run(self, image: Tensor, radar: Tensor, ground: Tensor) -> Depths:
        """As `Engine.run`."""
        key = (image.shape[0], image.shape[1], padded_count(len(radar)))
        if not self.failure and key not in self._captured:
            try:
                self._captured[key] = self._capture(*key)
            except RuntimeError as error:
                self.failure = str(error).splitlines()[0]
                self._captured.clear()
        if self.failure:
            return self._plain.run(image, radar, ground)
        return self._replay(self._captured[key], image, radar, ground)

    def warm_up(self, height: int, width: int) -> None:
        """Captures the graphs of an image size for the usual numbers of returns."""
        for returns in WARM_UP_RETURNS:
            self.run(*blank_frame(height, width, returns))

    def _replay(self, captured: Captured, image: Tensor, radar: Tensor, ground: Tensor) -> Depths:
        # All is done when this returns, so the next frame may write the same memory.
        with torch.inference_mode(), torch.cuda.device(self._device):
            compute, copies = torch.cuda.current_stream(), captured.copies
            captured.inputs.fill(image, radar, ground)
            with torch.cuda.stream(copies):
                captured.inputs.upload()
            compute.wait_stream(copies)
            captured.graph.replay()
            copies.wait_stream(compute)
            with torch.cuda.stream(copies):
                # torch keeps pinned memory that is freed, so this does not pin anew for each frame.
                results = each(captured.outputs, _download)
            copies.synchronize()
            return results

    def _capture(self, height: int, width: int, count: int) -> Captured:
        """Runs the network until it is settled, then records it; RuntimeError where it cannot be recorded."""
        with torch.inference_mode(), torch.cuda.device(self._device):
            inputs = Inputs(height, width, count, self._device)
            inputs.fill(*blank_frame(height, width, count))
            inputs.upload()
            aside = torch.cuda.Stream(self._device)  # type: ignore[no-untyped-call]  # torch leaves it without types
            aside.wait_stream(torch.cuda.current_stream())
            with torch.cuda.stream(aside):
                for _ in range(RUNS_BEFORE_CAPTURE):
                    forward(self._network, *inputs.device, self._dtype)
            torch.cuda.current_stream().wait_stream(aside)
            graph = torch.cuda.CUDAGraph()
            # One pool for all: graphs run one after another, and outputs are copied before the next one runs.
            pool = next((other.graph.pool() for other in self._captured.values()), None)
            with torch.cuda.graph(graph, pool=pool):
                outputs = forward(self._network, *inputs.device, self._dtype)
            copies = torch.cuda.Stream(self._device)  # type: ignore[no-untyped-call]  # torch leaves it without types
            return Captured(inputs, graph, outputs, copies)


def _download(maps: Tensor) -> Tensor:
    """Starts a copy to the host."""
    return torch.empty(maps.shape, dtype=maps.dtype, pin_memory=True).copy_(maps, non_blocking=True)
