"""Convolutions of images in which few pixels are known ([Uhrig2017])."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.layers.number_formats import Float32Conv2d


class SparseConv(nn.Module):
    """A convolution over the known pixels alone, divided by how many of them its window has.

    Args:
        in_channels: Channels of the input.
        out_channels: Channels of the result.
        kernel: Side of the window, odd.
        stride: Divides the size.
        in_float32: Compute in float32, whatever the format of the network.
    """

    def __init__(
        self, in_channels: int, out_channels: int, kernel: int, stride: int = 1, in_float32: bool = False
    ) -> None:
        super().__init__()
        self.keeps_float32 = in_float32  # the bias
        convolution = Float32Conv2d if in_float32 else nn.Conv2d
        self.conv = convolution(in_channels, out_channels, kernel, stride, kernel // 2, bias=False)
        self.bias = nn.Parameter(torch.zeros(out_channels))
        self.kernel = kernel
        self.stride = stride

    def forward(self, x: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
        """Takes (B, C, H, W) and (B, 1, H, W), 1 where it is known, to the same; what a window reaches is known."""
        count = functional.avg_pool2d(known, self.kernel, self.stride, self.kernel // 2)
        x = self.conv(x * known) / count.clamp(min=1.0 / (self.kernel * self.kernel))
        x = x / float(self.kernel * self.kernel) + self.bias.reshape(1, -1, 1, 1)
        return x, functional.max_pool2d(known, self.kernel, self.stride, self.kernel // 2)
