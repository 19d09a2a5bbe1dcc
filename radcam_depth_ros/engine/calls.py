"""Calls a network frame by frame, without state between frames."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn

from radcam_depth_ros.networks import Depths

WARM_UP_RETURNS = 8
CALLS_TO_SPECIALISE = 2


def forward(
    network: nn.Module,
    image: Tensor,
    radar: Tensor,
    valid: Tensor,
    ground: Tensor,
    dtype: torch.dtype,
    layout: torch.memory_format = torch.channels_last,
) -> Depths:
    """Calls a network with one frame.

    Args:
        network: Its weights are in `dtype`, on the device of all the tensors.
        image: (H, W, 3) uint8. Its memory is that of a channels_last image already.
        radar: (N, 6) float32.
        valid: (N,) bool.
        ground: (4,) float32.
        dtype: What the network computes in.
        layout: Memory format of the image that the network is given.

    Returns:
        Depths on the same device, in float32 but for the classes.
    """
    # bfloat16 holds 0 to 255 exactly, so the division is what rounds.
    pixels = image.permute(2, 0, 1).unsqueeze(0).to(dtype, memory_format=layout) / 255.0
    depths = Depths(*network(pixels, radar.unsqueeze(0), valid.unsqueeze(0), ground.unsqueeze(0)))
    return each(depths, lambda maps: maps.float() if maps.is_floating_point() else maps)


def each(depths: Depths, change: Callable[[Tensor], Tensor]) -> Depths:
    """Depths with every map changed; what a network does not give stays away."""
    dense, semi_dense, confidence = change(depths.dense), change(depths.semi_dense), change(depths.confidence)
    optional = (None if values is None else change(values) for values in (depths.classes, depths.sky))
    return Depths(dense, semi_dense, confidence, *optional)


class PlainCalls:
    """Calls a network as it is.

    Args:
        network: Its weights are in `dtype` and on `device`.
        device: Where it runs.
        dtype: What it computes in.
        layout: Memory format of the image that it is given.
    """

    def __init__(
        self,
        network: nn.Module,
        device: torch.device,
        dtype: torch.dtype,
        layout: torch.memory_format = torch.channels_last,
    ) -> None:
        self._network = network
        self._device = device
        self._dtype = dtype
        self._layout = layout
        self._is_specialised = False

    def run(self, image: Tensor, radar: Tensor, ground: Tensor) -> Depths:
        """As `Engine.run`."""
        with torch.inference_mode():
            image, radar, ground = (tensor.to(self._device) for tensor in (image, radar, ground))
            valid = torch.ones(len(radar), dtype=torch.bool, device=self._device)
            depths = forward(self._network, image, radar, valid, ground, self._dtype, self._layout)
            return each(depths, torch.Tensor.cpu)

    def warm_up(self, height: int, width: int) -> None:
        """Runs frames of that size until the next one is as fast as those after it."""
        # TorchScript profiles the first call and optimises in the second, once for all sizes. What the libraries keep
        # for each size, they make in one call.
        for _ in range(1 if self._is_specialised else CALLS_TO_SPECIALISE):
            self.run(*blank_frame(height, width, WARM_UP_RETURNS))
        self._is_specialised = True


def blank_frame(height: int, width: int, returns: int) -> tuple[Tensor, Tensor, Tensor]:
    """Image, radar and ground of a black image with so many returns in its middle, 10 m away."""
    at = torch.tensor([0.5 * width, 0.5 * height, 10.0, 0.0, 0.0, 0.0])
    return torch.zeros(height, width, 3, dtype=torch.uint8), at.repeat(returns, 1), torch.full((4,), float("nan"))
