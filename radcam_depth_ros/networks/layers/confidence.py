"""The confidence's probability from its logit, calibrated after training."""

import torch
from torch import Tensor, nn


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
