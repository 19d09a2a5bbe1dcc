"""Parts of `structured`; what holds for every network is in test_networks."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros import networks
from radcam_depth_ros.classes import CLASS_NAMES
from radcam_depth_ros.networks import ArchitectureError
from radcam_depth_ros.networks.layers.rasterise import depth_to_plane
from radcam_depth_ros.networks.layers.sparse import SparseConv
from radcam_depth_ros.networks.layers.up_projection import UpDecoder, UpProjection
from radcam_depth_ros.networks.structured import Structured
from radcam_depth_ros.networks.weights_io import torchscript
from radcam_depth_ros.networks.weights_io.folding import folded

NAN = float("nan")
REACH_PX = 16


def small(fusion: str = "seg", **values: object) -> Structured:
    torch.manual_seed(0)
    network = networks.create("structured", {"fusion": fusion, "backbone": "resnet18", "joined_channels": 64, **values})
    assert isinstance(network, Structured)
    return network.eval()


def inputs(radar: list[list[float]], batch: int = 1) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """An image of 64 x 96 pixels, and returns (u, v, depth) that all samples share."""
    generator = torch.Generator().manual_seed(1)
    rows = torch.tensor([[*row, NAN, NAN, 0.0] for row in radar]).reshape(-1, 6).expand(batch, -1, -1)
    valid = torch.ones(batch, len(radar), dtype=torch.bool)
    return torch.rand(batch, 3, 64, 96, generator=generator), rows, valid, torch.full((batch, 4), NAN)


def with_statistics(module: nn.Module) -> nn.Module:
    """Batch norms as after some training."""
    generator = torch.Generator().manual_seed(2)
    for norm in module.modules():
        if isinstance(norm, nn.BatchNorm2d):
            for values in (norm.running_mean, norm.running_var, norm.weight.data, norm.bias.data):
                assert values is not None
                values.copy_(0.5 + torch.rand(values.shape, generator=generator))
    return module.eval()


def test_up_projection_convolves_what_was_unpooled() -> None:
    torch.manual_seed(0)
    block = with_statistics(UpProjection(6, 3))
    assert isinstance(block, UpProjection)
    x = torch.randn(2, 6, 5, 7)
    unpooled = torch.zeros(2, 6, 10, 14)
    unpooled[:, :, ::2, ::2] = x
    transposed, norm = block.unpooled
    branches = norm(functional.conv2d(unpooled, transposed.weight.flip(2, 3).transpose(0, 1), padding=2))
    with torch.inference_mode():
        expected = functional.relu(block.upper(branches[:, :3]) + branches[:, 3:])
        torch.testing.assert_close(block(x), expected, rtol=1e-4, atol=1e-5)


def test_a_decoder_goes_from_a_32nd_to_a_half() -> None:
    features, result = UpDecoder(32, 19)(torch.randn(1, 32, 2, 3))
    assert features.shape == (1, 2, 32, 48)
    assert result.shape == (1, 19, 32, 48)


@pytest.mark.parametrize(("stride", "size"), [(1, (9, 13)), (2, (5, 7))])
def test_a_sparse_convolution_does_not_see_how_many_are_known(stride: int, size: tuple[int, int]) -> None:
    convolution = SparseConv(1, 1, 5, stride)
    with torch.no_grad():
        convolution.conv.weight.fill_(0.5)
        convolution.bias.fill_(0.25)
    known = torch.zeros(1, 1, 9, 13)
    known[0, 0, 1, 1] = known[0, 0, 2, 3] = 1.0
    values = torch.where(known > 0, 8.0, 100.0)
    with torch.inference_mode():
        found, reached = convolution(values, known)
    assert found.shape == reached.shape == (1, 1, *size)
    torch.testing.assert_close(found[reached > 0], torch.full((int(reached.sum()),), 0.5 * 8.0 + 0.25))
    rows, columns = torch.nonzero(reached[0, 0]).unbind(1)
    assert (int(rows.max()) * stride, int(columns.max()) * stride) == (4, 5 if stride == 1 else 4)


def test_norms_are_folded_also_where_they_are_numbered() -> None:
    network = with_statistics(small("single"))
    ready = folded(network)
    assert not [name for name, module in ready.named_modules() if isinstance(module, nn.BatchNorm2d)]
    given = inputs([[40.0, 30.0, 20.0]])
    with torch.inference_mode():
        torch.testing.assert_close(ready(*given).dense, network(*given).dense, rtol=1e-3, atol=1e-3)


def test_parameters_are_as_many_as_the_papers() -> None:
    """31.95 million, if "MB" of its table 1 means that: no ResNet-34 has less than 85 megabytes."""
    with torch.device("meta"):
        network = networks.create("structured", Structured.paper)
    assert sum(value.numel() for value in network.parameters()) == pytest.approx(31.95e6, rel=0.02)


@pytest.mark.parametrize("fusion", ["single", "add", "conf", "seg"])
def test_only_what_segments_gives_classes(fusion: str) -> None:
    network = small(fusion)
    with torch.inference_mode():
        depths = network(*inputs([[40.0, 30.0, 20.0]]))
    assert (depths.classes is not None) == (fusion == "seg")
    assert torch.isfinite(depths.dense).all()
    assert len(network.decoders) == (1 if fusion == "single" else 3)


def fuse(fusion: str, results: list[Tensor], classes: Tensor | None = None) -> Tensor:
    return small(fusion, ground_prior=False)._fused(results, classes, torch.full((1, 4), NAN))


def logit(depth_m: float) -> Tensor:
    """What a decoder says for a depth, (1, 1, 1, 1)."""
    return torch.logit(depth_to_plane(torch.full((1, 1, 1, 1), depth_m), 1.0, 100.0))


def test_a_pixel_takes_the_depth_of_the_decoder_of_what_it_shows() -> None:
    results = [logit(depth_m).expand(1, 1, 1, 4).clone().requires_grad_() for depth_m in (90.0, 30.0, 12.0)]
    shown = [CLASS_NAMES.index(name) for name in ("sky", "vegetation", "road", "car")]
    dense = fuse("seg", results, torch.tensor(shown).reshape(1, 1, 1, 4))
    torch.testing.assert_close(dense.flatten(), torch.tensor([90.0, 30.0, 12.0, 12.0]), rtol=1e-4, atol=0.0)
    dense.sum().backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    learns = [(result.grad != 0).flatten().tolist() for result in results if result.grad is not None]
    assert learns == [[True, False, False, False], [False, True, False, False], [False, False, True, True]]


def test_confidences_weigh_depths() -> None:
    shares = torch.log(torch.tensor([0.25, 0.25, 0.5])).reshape(3, 1, 1, 1, 1)
    results = [torch.cat([logit(depth_m), share], dim=1) for depth_m, share in zip((90, 30, 12), shares, strict=True)]
    assert float(fuse("conf", results)) == pytest.approx(0.25 * 90 + 0.25 * 30 + 0.5 * 12, rel=1e-4)


def test_a_decoder_may_take_the_roads_depth() -> None:
    ground = torch.tensor([[0.0, 0.0, 1 / 15.0, 1.0]])
    for gate, expected in ((-50.0, 40.0), (50.0, 15.0), (0.0, 27.5)):
        dense = small("add")._fused([torch.cat([logit(40.0), torch.full((1, 1, 1, 1), gate)], dim=1)], None, ground)
        assert float(dense) == pytest.approx(expected, rel=1e-4)


def test_adding_stays_within_the_range() -> None:
    assert float(fuse("add", [logit(90.0), logit(80.0), logit(95.0)])) <= 100.0
    assert float(fuse("add", [logit(10.0), logit(10.0), logit(30.0)])) == pytest.approx(30.0, rel=1e-4)


def test_semi_dense_depth_is_where_a_return_reaches_and_the_dense_one_agrees() -> None:
    coarse = torch.full((1, 1, 1, 4), 20.0)
    dense = torch.tensor([[[[20.0, 20.0, 26.0, 20.0]]]])
    reached = torch.tensor([[[[True, False, True, True]]]])
    confidence = torch.tensor([[[[0.9, 0.9, 0.9, 0.2]]]])
    found = small(threshold=0.3)._near_returns(coarse, reached, dense, confidence).flatten()
    torch.testing.assert_close(found, torch.tensor([20.0, NAN, NAN, NAN]), equal_nan=True)


def test_semi_dense_depth_stays_near_returns() -> None:
    with torch.inference_mode():
        found = small(threshold=0.01)(*inputs([[20.0, 30.0, 20.0], [500.0, 30.0, 20.0]])).semi_dense[0, 0]
    rows, columns = torch.nonzero(~torch.isnan(found)).unbind(1)
    assert len(rows)
    assert (columns - 20).abs().max() <= REACH_PX
    assert (rows - 30).abs().max() <= REACH_PX


def test_the_nearest_of_the_returns_of_a_pixel_counts() -> None:
    network = small()
    with torch.inference_mode():
        alone = network(*inputs([[40.0, 30.0, 9.0]]))
        both = network(*inputs([[40.0, 30.0, 60.0], [40.0, 30.0, 9.0]]))
    torch.testing.assert_close(alone.dense, both.dense)


def test_samples_without_a_return_teach_the_radar_branch_nothing() -> None:
    network = small().train()
    image, radar, valid, ground = inputs([[40.0, 30.0, 20.0]], batch=2)
    outputs = network.train_outputs(image, radar, torch.zeros_like(valid), ground)
    assert not outputs.reached.any()
    outputs.depths.dense.mean().backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    for name, parameter in network.radar_encoder.residual.named_parameters():
        assert parameter.grad is not None, name
        assert not parameter.grad.any(), name


def test_a_script_segments_as_the_network_does() -> None:
    network = small()
    given = inputs([[40.0, 30.0, 20.0], [70.0, 40.0, 9.0]])
    # With norms that know what maps are like; all pixels are but equal otherwise.
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.momentum = None
    with torch.no_grad():
        network.train()(*given)
        network.eval()
    frozen = torchscript.freeze(network)
    with torch.inference_mode():
        expected = network.outputs(*given)
        for _ in range(3):
            got = frozen(*given)
    assert expected.class_logits is not None
    assert expected.depths.classes is not None
    assert len(expected.depths.classes.unique()) > 1
    first, second = expected.class_logits.topk(2, dim=1).values.unbind(1)
    # Between classes that are all but equal, rounding decides.
    decided = (first - second > 1e-3).unsqueeze(1)
    assert decided.float().mean() > 0.8
    torch.testing.assert_close(got.classes[decided], expected.depths.classes[decided])
    torch.testing.assert_close(got.dense[decided], expected.depths.dense[decided], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    ("architecture", "message"),
    [
        ({"fusion": "magic"}, "fusion must be one of single, add, conf, seg, got 'magic'"),
        ({"backbone": "resnet50"}, "backbone must be one of resnet18, resnet34, got 'resnet50'"),
        ({"radar_channels": [0, 16, 32, 64, 128]}, "radar_channels must be at least 1"),
        ({"joined_channels": 100}, "joined_channels must be a multiple of 16, got 100"),
        ({"min_depth_m": 10, "max_depth_m": 5}, "depth range"),
        ({"threshold": 0}, "threshold must lie between 0 and 1"),
        ({"focal_length_px": -1}, "focal_length_px must be positive"),
    ],
)
def test_architectures_that_cannot_be(architecture: dict[str, object], message: str) -> None:
    with pytest.raises(ArchitectureError, match=message):
        networks.create("structured", architecture)
