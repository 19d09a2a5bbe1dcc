"""Batch norms folded into the convolutions before them, for networks that only run."""

import copy

import torch
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from radcam_depth_ros.networks.layers.number_formats import convert


def folded(network: nn.Module, dtype: torch.dtype = torch.float32, device: torch.device | str = "cpu") -> nn.Module:
    """A copy of a network for inference, in which convolutions do the work of the batch norms that follow them.

    Args:
        network: Any module; it is left as it is. Where a convolution and its batch norm are neighbours in an
            `nn.Sequential`, or named `conv1` and `bn1` as in a ResNet, they become one; other batch norms stay.
        dtype: Of the copy's weights, rounded once, after folding; modules that keep float32 keep it.
        device: Where the copy is.

    Returns:
        The copy, in evaluation mode, its weights channels_last.
    """
    result = copy.deepcopy(network).eval()
    for module in result.modules():
        if isinstance(module, nn.Sequential):
            _fold_members(module)
        else:
            _fold_numbered(module)
    # Convolutions on a CPU run about a third faster with channels last.
    return convert(result, dtype).to(device=device, memory_format=torch.channels_last)  # type: ignore[call-overload,no-any-return]  # torch's types lack the last


def _fold_members(members: nn.Sequential) -> None:
    for index in range(len(members) - 1):
        convolution, norm = members[index], members[index + 1]
        if isinstance(convolution, nn.Conv2d | nn.ConvTranspose2d) and isinstance(norm, nn.BatchNorm2d):
            is_transposed = isinstance(convolution, nn.ConvTranspose2d)
            if is_transposed and convolution.groups > 1:
                continue  # torch folds these into weights of the wrong shape
            members[index] = fuse_conv_bn_eval(convolution, norm, is_transposed)
            members[index + 1] = nn.Identity()


def _fold_numbered(block: nn.Module) -> None:
    members = dict(block.named_children())
    for name, norm in members.items():
        convolution = members.get(name.replace("bn", "conv", 1))
        if isinstance(convolution, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
            setattr(block, name.replace("bn", "conv", 1), fuse_conv_bn_eval(convolution, norm))
            setattr(block, name, nn.Identity())
