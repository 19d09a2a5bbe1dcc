from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.nn import functional

from radcam_depth_ros.networks.layers.blocks import InstanceNorm

LAYOUTS = (torch.contiguous_format, torch.channels_last)


def made(channels: int) -> InstanceNorm:
    generator = torch.Generator().manual_seed(5)
    norm = InstanceNorm(channels).eval()
    with torch.no_grad():
        norm.weight.uniform_(0.5, 1.5, generator=generator)
        norm.bias.normal_(generator=generator)
    return norm


def maps(batch: int, channels: int, layout: torch.memory_format) -> Tensor:
    generator = torch.Generator().manual_seed(6)
    values = 1.0 + 2.0 * torch.randn(batch, channels, 56, 100, generator=generator)
    return values.contiguous(memory_format=layout)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("batch", [1, 2])
@pytest.mark.parametrize("is_training", [False, True])
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 2e-5), (torch.bfloat16, 2e-2)])
def test_an_instance_norm_is_torchs_group_norm(
    layout: torch.memory_format, batch: int, is_training: bool, dtype: torch.dtype, tolerance: float
) -> None:
    norm, x = made(24).train(is_training), maps(batch, 24, layout).to(dtype)
    exact = functional.group_norm(x.double(), 24, norm.weight.double(), norm.bias.double(), norm.eps)
    with torch.inference_mode(not is_training):
        result = norm(x)
    assert result.dtype == dtype
    assert result.is_contiguous(memory_format=layout)
    torch.testing.assert_close(result.double(), exact, rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("value", [0.0, 3.0, -250.0])
def test_a_constant_image_gives_the_bias(layout: torch.memory_format, value: float) -> None:
    """Such as a black one."""
    norm, x = made(8), torch.full((1, 8, 56, 100), value).contiguous(memory_format=layout)
    expected = norm.bias.reshape(1, -1, 1, 1).expand_as(x)
    with torch.inference_mode():
        torch.testing.assert_close(norm(x), expected, rtol=0, atol=0.01)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("value", [30.0, 300.0])
def test_an_all_but_constant_image_gives_no_nan(layout: torch.memory_format, value: float) -> None:
    """Rounding must not make a variance negative."""
    x = value + (maps(1, 64, layout) - 1.0) * 5e-5 * value
    with torch.inference_mode():
        assert torch.isfinite(made(64)(x)).all()


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("channels", [16, 24, 64, 160])
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_an_instance_norm_is_the_same_to_the_digit_for_any_number_of_threads(
    layout: torch.memory_format, channels: int, dtype: torch.dtype
) -> None:
    norm, x = made(channels), maps(1, channels, layout).to(dtype)
    results = []
    with torch.inference_mode():
        for threads in (1, 2, 3, 8):
            torch.set_num_threads(threads)
            results.append(norm(x))
    for result in results[1:]:
        torch.testing.assert_close(result, results[0], rtol=0, atol=0)


@pytest.mark.parametrize("is_training", [False, True])
def test_an_instance_norm_learns_from_one_image_as_from_many(is_training: bool) -> None:
    gradients = []
    for batch in (1, 2):
        norm, x = made(8).train(is_training), maps(1, 8, torch.contiguous_format).expand(batch, -1, -1, -1).clone()
        x.requires_grad_()
        norm(x).square().mean().backward()
        gradients.append((norm.weight.grad, norm.bias.grad, x.grad[0] * batch))
    for one, two in zip(*gradients, strict=True):
        torch.testing.assert_close(one, two)
