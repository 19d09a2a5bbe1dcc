"""What networks tell beside the dense depth: the confidence's probability, the sky's logit, the returns they trust."""

import torch
from torch import Tensor, nn

from radcam_depth_ros.networks.layers.number_formats import Float32Conv2d

RELATIVE, METRES = 0.2, 4.0
"""Differences from the dense depth: at either a return counts 1 / e as much as without any."""

FAR_M = 80.0
"""At this distance a confidence counts 1 / e as much as right before the camera."""


class CalibratedConfidence(nn.Module):
    """Platt scaling ([Platt1999]): sigmoid(scale * logit + offset).

    A network's own probabilities are those of its training, with disturbed pictures and roads. Scale and offset are
    fitted on held-out drives (`training.validation`) and stand in the card. What the network itself does with its
    confidence, and what its losses see, is the logit as it was.

    Args:
        calibration: Scale, above 0, and offset.
    """

    def __init__(self, calibration: tuple[float, float]) -> None:
        super().__init__()
        self.scale, self.offset = (float(value) for value in calibration)

    def forward(self, logit: Tensor) -> Tensor:
        """A logit, of any shape, to a probability in float32."""
        return torch.sigmoid(self.scale * logit.float() + self.offset)


def sky_head(channels: int) -> Float32Conv2d:
    """A convolution of a map (B, channels, H, W) to the sky's logit (B, 1, H, W) float32, near -1 before training.

    Not in the papers.
    """
    head = Float32Conv2d(channels, 1, 3, padding=1)
    nn.init.normal_(head.weight, std=0.01)
    nn.init.constant_(head.get_parameter("bias"), -1.0)
    return head


class TrustedReturns(nn.Module):
    """Keeps depths of returns that the dense depth and its confidence bear out.

    The confidence is that of 10 % of the depth, which is more metres far away: there it has to be higher. The constants
    were chosen on held-out drives (docs/results.md).

    Args:
        threshold: tau, the score, 0 to 1, above which a pixel takes its return's depth.
    """

    def __init__(self, threshold: float) -> None:
        super().__init__()
        self.threshold = threshold
        self.relative, self.metres, self.far_m = RELATIVE, METRES, FAR_M

    def forward(self, found_m: Tensor, dense_m: Tensor, confidence: Tensor) -> Tensor:
        """The semi-dense depth (B, 1, H, W) in metres; NaN where there is none. Only `found_m` learns from it.

        Args:
            found_m: (B, 1, H, W) metres, of the return that a pixel may have; NaN where it may have none.
            dense_m: (B, 1, H, W) metres, positive.
            confidence: (B, 1, H, W), 0 to 1.
        """
        dense_m = dense_m.detach()
        apart = torch.log(found_m / dense_m).abs() / self.relative + (found_m - dense_m).abs() / self.metres
        score = confidence.detach().square() * torch.exp(-(apart + dense_m / self.far_m))
        return torch.where(score > self.threshold, found_m, torch.full_like(found_m, float("nan")))
