"""What networks tell beside depth: the confidence's probability, calibrated after training, and the sky's logit."""

import torch
from torch import Tensor, nn

from radcam_depth_ros.networks.layers.number_formats import Float32Conv2d


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
