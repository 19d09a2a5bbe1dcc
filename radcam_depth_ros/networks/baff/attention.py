"""Channel and position attention ([Electronics2025], section 3.5, after [Fu2019])."""

import torch
from torch import Tensor, nn
from torch.nn import functional


class ChannelAttention(nn.Module):
    """Softmax of the C x C product of the flattened map with itself, times the map, times alpha, plus the map."""

    def __init__(self) -> None:
        super().__init__()
        self.alpha = nn.Parameter(torch.zeros(1))

    def forward(self, x: Tensor) -> Tensor:
        pixels = x.shape[2] * x.shape[3]
        flat = _tokens(x)
        # Deviation: the product is divided by the number of pixels. The paper's sum grows with the image, so that its
        # softmax would mean something else at each size.
        product = torch.bmm(flat.transpose(1, 2), flat).float() / pixels
        # The identity and alpha join the C x C matrix, so that the map is read once.
        weight = self.alpha.float() * torch.softmax(product, dim=2) + torch.eye(x.shape[1], device=x.device)
        return _image(torch.bmm(flat, weight.to(flat.dtype).transpose(1, 2)), x)


class PositionAttention(nn.Module):
    """Softmax of the N x N product of positions, times values, times beta, plus the map; N x N is never built.

    Args:
        channels: Channels of the map.
        pool: Keys and values are averaged over about pool x pool pixels: 1 is the paper's exact form. At fine levels
            the exact form costs seconds (N = 90,000 at 1/2 of 448 x 800), the pooled one milliseconds.
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
        source = x
        if self.pool > 1:
            # At least two rows and columns: torch.export takes a size of 1 for fixed.
            rows, columns = (x.shape[2] - 1) // self.pool + 1, (x.shape[3] - 1) // self.pool + 1
            source = functional.adaptive_avg_pool2d(x, (max(rows, 2), max(columns, 2)))
        # Deviation: logits are divided by the square root of the width ([Vaswani2017]), as the fused attention
        # does by default; without it the softmax saturates in bfloat16.
        attended = functional.scaled_dot_product_attention(
            _tokens(self.query(x)).unsqueeze(1),
            _tokens(self.key(source)).unsqueeze(1),
            _tokens(self.value(source)).unsqueeze(1),
        )
        return self.beta * _image(attended.squeeze(1), x) + x


class ParallelAttention(nn.Module):
    """CA(F) + PA(F), with either or both left out for ablation; F where both are."""

    def __init__(self, channels: int, pool: int, use_channel: bool, use_position: bool) -> None:
        super().__init__()
        branches: list[nn.Module] = []
        if use_channel:
            branches.append(ChannelAttention())
        if use_position:
            branches.append(PositionAttention(channels, pool))
        if not branches:
            branches.append(nn.Identity())
        self.branches = nn.ModuleList(branches)

    def forward(self, x: Tensor) -> Tensor:
        total = torch.zeros(1, device=x.device, dtype=x.dtype)
        for branch in self.branches:
            total = total + branch(x)
        return total


def _tokens(x: Tensor) -> Tensor:
    """(B, C, h, w) to (B, h w, C): no copy where channels are last in memory."""
    return x.permute(0, 2, 3, 1).reshape(x.shape[0], -1, x.shape[1])


def _image(tokens: Tensor, like: Tensor) -> Tensor:
    """(B, h w, C) back to an image of the size of `like`, channels last in memory."""
    return tokens.reshape(like.shape[0], like.shape[2], like.shape[3], like.shape[1]).permute(0, 3, 1, 2)
