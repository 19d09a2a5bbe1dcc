"""Channel and position attention (Electronics 2025, section 3.5; after Fu et al., dual attention, 2019)."""

import torch
from torch import Tensor, nn
from torch.nn import functional


class ChannelAttention(nn.Module):
    """Softmax of the C x C product of the flattened map with itself, times the map, times alpha, plus the map."""

    def __init__(self) -> None:
        super().__init__()
        self.alpha = nn.Parameter(torch.zeros(1))

    def forward(self, x: Tensor) -> Tensor:
        batch, channels, height, width = x.shape
        flat = x.reshape(batch, channels, height * width)
        # Deviation: the product is divided by the number of pixels. The paper's sum grows with the image, so that its
        # softmax would mean something else at each size.
        product = torch.bmm(flat, flat.transpose(1, 2)) / (height * width)
        weighted = torch.bmm(torch.softmax(product.float(), dim=2).to(flat.dtype), flat)
        return self.alpha * weighted.reshape(batch, channels, height, width) + x


class PositionAttention(nn.Module):
    """Softmax of the N x N product of positions, times values, times beta, plus the map; N x N is never built.

    Args:
        channels: Channels of the map.
        pool: Keys and values are averaged over pool x pool pixels: 1 is the paper's exact form. At fine levels the
            exact form costs seconds (N = 90,000 at 1/2 of 448 x 800), the pooled one milliseconds.
    """

    def __init__(self, channels: int, pool: int) -> None:
        super().__init__()
        self.pool = pool
        # As wide as the values: narrower queries make the fused attention fall back to building N x N.
        self.query = nn.Conv2d(channels, channels, 1)
        self.key = nn.Conv2d(channels, channels, 1)
        self.value = nn.Conv2d(channels, channels, 1)
        self.beta = nn.Parameter(torch.zeros(1))

    def forward(self, x: Tensor) -> Tensor:
        source = functional.avg_pool2d(x, self.pool) if self.pool > 1 else x
        # Deviation: logits are divided by the square root of the width (Vaswani et al. 2017), as the fused attention
        # does by default; without it the softmax saturates in bfloat16.
        attended = functional.scaled_dot_product_attention(
            _tokens(self.query(x)), _tokens(self.key(source)), _tokens(self.value(source))
        )
        return self.beta * attended.squeeze(1).transpose(1, 2).reshape(x.shape) + x


def _tokens(x: Tensor) -> Tensor:
    """(B, C, h, w) to (B, 1, h w, C), contiguous."""
    return x.flatten(2).transpose(1, 2).unsqueeze(1).contiguous()
