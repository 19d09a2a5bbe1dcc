"""Statistics of a whole picture: how bright, how contrasty and how noisy it is."""

from typing import Final

import torch
from torch import Tensor, nn
from torch.nn import functional


class ImageStatistics(nn.Module):
    """Measures a picture, so that a network can tell pictures that say little: black, noisy or blurred ones.

    Norms by a picture's own statistics hide all of this from the layers that follow them.
    """

    COUNT: Final[int] = 9
    keeps_float32 = True

    def forward(self, image: Tensor) -> Tensor:
        """Takes (B, 3, H, W), 0 to 1, to (B, 9) float32.

        Mean and deviation of the brightness; logarithms of the mean step between neighbours at 1/1, 1/4 and 1/16;
        shares of black and of white pixels; saturation; logarithm of the deviation at 1/16.
        """
        # Some of the rows stand for all: the finest steps are most of the cost.
        some = image[:, :, ::4].float()
        rows, grey = some.mean(dim=1), image.float().mean(dim=1, keepdim=True)
        quarter = functional.avg_pool2d(grey, 4)
        coarse = functional.avg_pool2d(quarter, 4)
        thin = some[:, :, :, ::4]
        flat = rows.flatten(1)
        return torch.stack(
            [
                grey.mean(dim=(1, 2, 3)),
                flat.std(dim=1),
                _steps(rows),
                _steps(quarter[:, 0]),
                _steps(coarse[:, 0]),
                (flat < 0.04).float().mean(dim=1),
                (flat > 0.96).float().mean(dim=1),
                (thin.amax(dim=1) - thin.amin(dim=1)).mean(dim=(1, 2)),
                torch.log(coarse.flatten(1).std(dim=1) + 1e-3),
            ],
            dim=1,
        )


def _steps(grey: Tensor) -> Tensor:
    """Logarithm of the mean absolute difference of neighbours along the rows of (B, h, w)."""
    return torch.log((grey[:, :, 1:] - grey[:, :, :-1]).abs().mean(dim=(1, 2)) + 1e-3)
