"""Number formats of a network: modules that stay in float32 while the others compute in bfloat16."""

import torch
from torch import Tensor, nn
from torch.jit import is_scripting  # type: ignore[attr-defined]  # torch does not name it among its exports
from torch.nn import functional


class InFloat32(nn.Module):
    """Base of modules that compute in float32, whatever the format of the network around them.

    A depth that a layer gives in bfloat16 has steps of 0.4 % of a logit, which the depth range's logarithm widens. Such
    layers derive from this class: `convert` leaves their weights in float32, and autocast does not reach them.
    """

    keeps_float32 = True

    def forward(self, x: Tensor) -> Tensor:
        """`compute` in float32; the result is float32, but for `RawConv2d`."""
        # TorchScript does not compile what stands below `is_scripting`; a meta device knows no autocast.
        if not is_scripting():  # noqa: SIM102
            if torch.amp.is_autocast_available(x.device.type):
                with torch.autocast(x.device.type, enabled=False):
                    return self.compute(x.float())
        return self.compute(x.float())

    def compute(self, x: Tensor) -> Tensor:
        """What the module does with a float32 map; float32 out, but for `RawConv2d`."""
        raise NotImplementedError


class Float32Conv2d(InFloat32, nn.Conv2d):
    """`nn.Conv2d` in float32: the last layer before a logit that becomes metres."""

    def compute(self, x: Tensor) -> Tensor:
        result: Tensor = self._conv_forward(x, self.weight, self.bias)
        return result


class Float32Linear(InFloat32, nn.Linear):
    """`nn.Linear` in float32."""

    def compute(self, x: Tensor) -> Tensor:
        return functional.linear(x, self.weight, self.bias)


class NetworkFormat(nn.Module):
    """Holds the format that the network around it computes in: `convert` changes it, also within float32 modules."""

    values: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("values", torch.zeros(1), persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """`x` in that format."""
        return x.to(self.values.dtype)


class RawConv2d(Float32Conv2d):
    """The first convolution of raw values, such as pixels or planes of depth: from float32 to the network's format.

    Raw values are large beside their differences, and such a layer has few weights: rounding them, and planes of depth,
    is most of what separates the depths of two formats (docs/decisions.md). Its result is rounded without harm.
    """

    def __init__(
        self, in_channels: int, out_channels: int, kernel: int, stride: int = 1, padding: int = 0, bias: bool = True
    ) -> None:
        super().__init__(in_channels, out_channels, kernel, stride, padding, bias=bias)
        self.rounded = NetworkFormat()

    def compute(self, x: Tensor) -> Tensor:
        result: Tensor = self.rounded(self._conv_forward(x, self.weight, self.bias))
        return result


def convert(network: nn.Module, dtype: torch.dtype) -> nn.Module:
    """Converts a network's parameters and buffers, in place, but for those of modules that keep float32.

    Args:
        network: Any module; those of its modules that have a true `keeps_float32` keep their own values as they are.
        dtype: Of all other floating-point values.

    Returns:
        The network.
    """
    for module in network.modules():
        if getattr(module, "keeps_float32", False):
            continue
        for parameter in module.parameters(recurse=False):
            if parameter.is_floating_point():
                parameter.data = parameter.data.to(dtype)
        for name, values in list(module.named_buffers(recurse=False)):
            if values.is_floating_point():
                setattr(module, name, values.to(dtype))
    return network
