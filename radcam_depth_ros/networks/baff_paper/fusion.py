"""Stage 2 in the paper's form: encoders of its own, from 1/2 of the image size on ([Electronics2025], section 3.3)."""

from torch import Tensor, nn

from radcam_depth_ros.networks.baff.fusion import BidirectionalFusion, Gates, Refinement
from radcam_depth_ros.networks.layers.blocks import ConvBlock, ResidualEncoder, double
from radcam_depth_ros.networks.layers.number_formats import Float32Conv2d


class PaperFusion(nn.Module):
    """Stage 2 as the paper has it: encoders of its own, levels from 1/2 on, a head at the image's size.

    Args:
        pools: How far keys and values of PA are pooled at 1/2, 1/4, 1/8, 1/16.
        bottom_up: BF.
        channel_attention: CA.
        position_attention: PA.
    """

    CHANNELS = (16, 32, 64, 128, 256)

    def __init__(
        self, pools: tuple[int, ...], bottom_up: bool, channel_attention: bool, position_attention: bool
    ) -> None:
        super().__init__()
        channels = self.CHANNELS
        self.image_encoder = ResidualEncoder(3, channels)
        self.depth_encoder = ResidualEncoder(2, channels)
        self.gates = Gates(channels, 3)
        self.bidirectional = BidirectionalFusion(channels, bottom_up, coarse=False)
        self.refinement = Refinement(channels[:4], pools, channel_attention, position_attention, coarse=False)
        self.head = nn.Sequential(ConvBlock(channels[0], channels[0]), Float32Conv2d(channels[0], 2, 3, padding=1))

    def forward(self, image: Tensor, depth: Tensor) -> Tensor:
        """Image (B, 3, H, W) and depth planes (B, 2, H, W) to depth and confidence before their sigmoids."""
        fused = self.gates(self.image_encoder(image), self.depth_encoder(depth))
        result: Tensor = self.head(double(self.refinement(self.bidirectional(fused))))
        return result
