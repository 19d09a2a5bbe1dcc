"""Batch norms in training of several processes, and with statistics that stay as they are."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from radcam_depth_ros.training.distributed.ranks import Ranks


class JointBatchNorm(nn.BatchNorm2d):
    """A batch norm over the parts of a batch that several processes have.

    As torch's SyncBatchNorm, but for any device.

    Args:
        norm: The batch norm in whose place it is.
        ranks: The processes; each has as many pixels.
    """

    def __init__(self, norm: nn.BatchNorm2d, ranks: Ranks) -> None:
        super().__init__(norm.num_features, norm.eps, norm.momentum, norm.affine, norm.track_running_stats)
        self.load_state_dict(norm.state_dict())
        self._ranks = ranks

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W), of the same type."""
        if not self.training or self.running_mean is None or self.running_var is None or self.momentum is None:
            return super().forward(x)
        values = x if x.dtype == torch.float64 else x.float()
        count = values.numel() // values.shape[1] * self._ranks.size
        mean = self._ranks.add_with_gradient(values.sum(dim=(0, 2, 3))) / count
        values = values - mean[:, None, None]
        variance = self._ranks.add_with_gradient(values.square().sum(dim=(0, 2, 3))) / count
        with torch.no_grad():
            self.running_mean.lerp_(mean, self.momentum)
            self.running_var.lerp_(variance * (count / max(count - 1, 1)), self.momentum)
            if self.num_batches_tracked is not None:
                self.num_batches_tracked.add_(1)
        scale = torch.rsqrt(variance + self.eps) * self.weight
        return (values * scale[:, None, None] + self.bias[:, None, None]).to(x.dtype)


def join_batch_norms(network: nn.Module, ranks: Ranks) -> None:
    """Puts a joint batch norm in the place of each batch norm."""
    for module in list(network.modules()):
        for name, child in module.named_children():
            if type(child) is nn.BatchNorm2d:
                setattr(module, name, JointBatchNorm(child, ranks))


@torch.no_grad()
def share_statistics(network: nn.Module, ranks: Ranks) -> None:
    """Gives all processes the mean of the running statistics of their batch norms."""
    if ranks.size == 1:
        return
    norms = [module for module in network.modules() if isinstance(module, nn.BatchNorm2d)]
    values = [value for norm in norms for value in (norm.running_mean, norm.running_var) if value is not None]
    if not values:
        return
    # One vector, since each exchange costs time whatever its size.
    means = ranks.add(torch.cat(values)) / ranks.size
    for value, mean in zip(values, torch.split(means, [len(value) for value in values]), strict=True):
        value.copy_(mean)


def freeze_statistics(network: nn.Module) -> None:
    """Lets batch norms use the statistics that they have, until the network is put in training mode again."""
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.eval()
