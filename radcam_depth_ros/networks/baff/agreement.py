"""The semi-dense depth: stage 1's return, where both stages are sure of it and agree.

Deviation: in [Electronics2025] stage 1 decides alone. Stage 2 has seen more, and what it says comes for nothing
(docs/decisions.md).
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

RELATIVE, METRES = 0.3, 4.0
"""Differences of the stages' depths: at either one a return counts 1 / e as much as without any."""


class Agreement(nn.Module):
    """Keeps the returns that both stages stand by.

    Args:
        threshold: The score, 0 to 1, above which a pixel takes its return's depth.
        min_depth_m: The nearest that stage 2's depth can be: a return nearer than that is compared as if it lay there.
    """

    def __init__(self, threshold: float, min_depth_m: float) -> None:
        super().__init__()
        self.threshold = threshold
        self.min_depth_m = min_depth_m
        self.relative, self.metres = RELATIVE, METRES

    def forward(self, probability: Tensor, depth_m: Tensor, dense_m: Tensor, confidence_logit: Tensor) -> Tensor:
        """The semi-dense depth (B, 1, h, w) in metres; NaN where there is none.

        Args:
            probability: (B, 1, h, w), stage 1's for its likeliest return.
            depth_m: (B, 1, h, w), the depth of that return in metres.
            dense_m: (B, 1, h', w'), stage 2's depth in metres.
            confidence_logit: (B, 1, h', w'), stage 2's.
        """
        size = (probability.shape[2], probability.shape[3])
        dense = functional.interpolate(dense_m, size, mode="bilinear")
        confidence = torch.sigmoid(functional.interpolate(confidence_logit.float(), size, mode="bilinear"))
        apart = torch.log(depth_m.clamp(min=self.min_depth_m) / dense).abs() / self.relative
        apart = apart + (depth_m - dense).abs() / self.metres
        # Stage 2's word weighs more: it knows what is in front. Powers and differences were chosen on held-out drives.
        score = probability.sqrt().sqrt() * confidence.square() * torch.exp(-apart)
        return torch.where(score > self.threshold, depth_m, torch.full_like(depth_m, float("nan")))
