"""Statistics of a whole picture: how bright, how contrasty and how noisy it is."""

from typing import Final

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.layers.blocks import LEAK, reduced
from radcam_depth_ros.networks.layers.number_formats import Float32Linear, InFloat32

TYPICAL = (0.44, 0.16, -4.14, -4.02, -3.69, 0.05, 0.06, 0.13, -2.37, 3.76)
SCALES = (4.67, 11.0, 0.86, 1.35, 1.44, 5.1, 6.8, 6.0, 0.83, 0.62)
"""Of simulated frames: means of `ImageStatistics` and of log(1 + returns), and the inverse of their deviations."""

HIDDEN = 16
"""Width between the two layers of `FromStatistics`."""


class ImageStatistics(nn.Module):
    """Measures a picture, so that a network can tell pictures that say little: black, noisy or blurred ones.

    Norms by a picture's own statistics hide all of this from the layers that follow them.
    """

    COUNT: Final[int] = 9

    def forward(self, image: Tensor) -> Tensor:
        """Takes (B, 3, H, W), 0 to 1, to (B, 9) float32.

        Mean and deviation of the brightness; logarithms of the mean step between neighbours at 1/1, 1/4 and 1/16;
        shares of black and of white pixels; saturation; logarithm of the deviation at 1/16.
        """
        # Some of the rows stand for all: the finest steps are most of the cost.
        some = image[:, :, ::4].float()
        rows, quarter = some.mean(dim=1), reduced(image, 4).mean(dim=1, keepdim=True)
        coarse = functional.avg_pool2d(quarter, 4)
        thin = some[:, :, :, ::4]
        return torch.stack(
            [
                _mean(quarter),
                _deviation(rows),
                _steps(rows),
                _steps(quarter[:, 0]),
                _steps(coarse[:, 0]),
                _mean((rows < 0.04).float()),
                _mean((rows > 0.96).float()),
                _mean(thin.amax(dim=1) - thin.amin(dim=1)),
                torch.log(_deviation(coarse) + 1e-3),
            ],
            dim=1,
        )


def _steps(grey: Tensor) -> Tensor:
    """Logarithm of the mean absolute difference of neighbours along the rows of (B, h, w)."""
    return torch.log(_mean((grey[:, :, 1:] - grey[:, :, :-1]).abs()) + 1e-3)


def _mean(x: Tensor) -> Tensor:
    """Mean of each (..., W) of (B, ..., W), the same to the digit for any number of threads: row by row first.

    A sum of a single image's pixels would be one of parts, as many as there are threads.
    """
    return x.mean(dim=-1).flatten(1).mean(dim=1)


def _deviation(x: Tensor) -> Tensor:
    """Standard deviation, as `_mean` takes means."""
    pixels = x.flatten(1).shape[1]
    away = x.flatten(1) - _mean(x).unsqueeze(1)
    return torch.sqrt(_mean((away * away).reshape(x.shape)) * (pixels / max(pixels - 1, 1)))


class FrameStatistics(nn.Module):
    """How far a frame's picture and number of returns are from those of simulated frames, in standard deviations.

    They are scaled by constants, so that a batch of one picture trains as well as a large one.
    """

    COUNT: Final[int] = len(TYPICAL)
    keeps_float32 = True
    mean: Tensor
    scale: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.measure = ImageStatistics()
        self.register_buffer("mean", torch.tensor(TYPICAL), persistent=False)
        self.register_buffer("scale", torch.tensor(SCALES), persistent=False)

    def forward(self, image: Tensor, valid: Tensor) -> Tensor:
        """Takes (B, 3, H, W), 0 to 1, and (B, N) bool, which returns there are, to (B, 10) float32."""
        returns = torch.log1p(valid.float().sum(dim=1, keepdim=True))
        return (torch.cat([self.measure(image), returns], dim=1) - self.mean) * self.scale


class FromStatistics(InFloat32):
    """Values that a layer adds for a whole frame: two linear layers on `FrameStatistics`, in float32.

    Args:
        bias: (width,), what it gives before training.
    """

    def __init__(self, bias: Tensor) -> None:
        super().__init__()
        self.hidden = Float32Linear(len(TYPICAL), HIDDEN)
        self.activation = nn.LeakyReLU(LEAK)
        self.last = Float32Linear(HIDDEN, len(bias))
        with torch.no_grad():
            self.last.weight.mul_(0.1)
            self.last.bias.copy_(bias)

    def compute(self, x: Tensor) -> Tensor:
        """(B, 10) to (B, width)."""
        result: Tensor = self.last(self.activation(self.hidden(x)))
        return result
