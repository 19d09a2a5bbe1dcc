"""A network that is ready to run."""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn

from radcam_depth_ros.networks import Depths, archive

_DTYPES = {"auto": torch.float32, "float32": torch.float32, "bfloat16": torch.bfloat16}


class Engine:
    """Runs a network; it is copied, so the one that is given stays as it is.

    Args:
        network: In evaluation mode, float32.
        device: Where it runs.
        precision: `auto`, `float32` or `bfloat16`.
        mode: `frozen`, or `eager` as the reference.

    Attributes:
        network: The network as it runs: on the device, in the precision, frozen where `mode` says so.
        precision: What it runs in.
    """

    def __init__(
        self, network: nn.Module, device: str | torch.device = "cpu", precision: str = "auto", mode: str = "frozen"
    ) -> None:
        self._device = torch.device(device)
        self._dtype = _DTYPES[precision]
        self.precision = "float32" if precision == "auto" else precision
        copied = network if isinstance(network, torch.jit.ScriptModule) else copy.deepcopy(network)
        copied = copied.eval().to(self._device, self._dtype)
        for parameter in copied.parameters():
            if parameter.dim() == 4:
                parameter.data = parameter.data.contiguous(memory_format=torch.channels_last)
        self.network: nn.Module = archive.freeze(copied) if mode == "frozen" else copied

    def describe(self) -> str:
        """One line: precision and device."""
        return f"{self.precision} on {self._device}"

    def run(self, image: Tensor, radar: Tensor, ground: Tensor) -> Depths:
        """Takes image (H, W, 3) uint8, radar (N, 6) and ground (3,) float32 to depths (1, 1, H, W), all on the CPU."""
        with torch.inference_mode():
            pixels = image.to(self._device).permute(2, 0, 1).unsqueeze(0).to(self._dtype) / 255.0
            returns = radar.to(self._device).unsqueeze(0)
            valid = torch.ones(returns.shape[:2], dtype=torch.bool, device=self._device)
            depths = self.network(pixels, returns, valid, ground.to(self._device).unsqueeze(0))
            return Depths(*(value.float().cpu() for value in depths))

    def warm_up(self, height: int, width: int) -> None:
        """Runs until TorchScript has specialised the network for a size."""
        for _ in range(3):
            self.run(torch.zeros(height, width, 3, dtype=torch.uint8), torch.ones(1, 6), torch.full((3,), torch.nan))
