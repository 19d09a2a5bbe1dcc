"""The sky's logit from a decoder's finest map; not in the papers."""

from torch import nn

from radcam_depth_ros.networks.layers.number_formats import Float32Conv2d


def sky_head(channels: int) -> Float32Conv2d:
    """A convolution of a map (B, channels, H, W) to the sky's logit (B, 1, H, W) float32, near -1 before training."""
    head = Float32Conv2d(channels, 1, 3, padding=1)
    nn.init.normal_(head.weight, std=0.01)
    if head.bias is not None:
        nn.init.constant_(head.bias, -1.0)
    return head
