"""What every network in the registry must hold."""

from __future__ import annotations

import itertools
import subprocess
import sys
import warnings
from collections.abc import Iterator

import pytest
import torch
from torch import Tensor

from radcam_depth_ros import networks
from radcam_depth_ros.classes import CLASS_NAMES
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.networks import ArchitectureError
from radcam_depth_ros.networks.baff.agreement import Agreement
from radcam_depth_ros.networks.baff.head import CANDIDATES, DEPTH_BINS, FARTHEST_BIN, NEAREST_BIN
from radcam_depth_ros.networks.baff.network import Baff
from radcam_depth_ros.networks.baff_paper.network import BaffPaper
from radcam_depth_ros.networks.interface import Network
from radcam_depth_ros.networks.layers.rasterise import plane_to_depth
from radcam_depth_ros.networks.weights_io import torchscript

Inputs = tuple[Tensor, Tensor, Tensor, Tensor]
BAFF_FORMS: dict[str, tuple[str, dict[str, object]]] = {
    "baff": ("baff", {}),
    "baff-context": ("baff", {"context": "mobilenet_v2"}),
    "baff-regions": ("baff", {"association": "regions", "radar_map_size": [4, 5]}),
    "baff_paper": ("baff_paper", {"region_width_px": 96, "radar_map_size": [4, 5]}),
}
FORMS: dict[str, tuple[str, dict[str, object]]] = {
    **{name: (name, {}) for name in networks.names()},
    **BAFF_FORMS,
    "structured-conf": ("structured", {"backbone": "resnet18", "fusion": "conf"}),
    # With a low tau every return that can win pixels does so, and rounding does not decide which.
    "cafnet": ("cafnet", {"threshold": 0.01}),
    "lircdepth": ("lircdepth", {"threshold": 0.01}),
}
SIZES = [(32, 32), (64, 96), (96, 64)]
COUNTS = [0, 1, 9]


def make_inputs(batch: int, height: int, width: int, count: int, seed: int = 0) -> Inputs:
    generator = torch.Generator().manual_seed(seed)
    radar = torch.rand(batch, count, 6, generator=generator)
    radar = radar * torch.tensor([1.2 * width, height, 80.0, 20.0, 10.0, 0.1]) + torch.tensor([-5.0, 0, 2, 0, 0, 0])
    if count > 1:
        radar[:, 1, 3:] = float("nan")
    valid = torch.rand(batch, count, generator=generator) > 0.2
    ground = torch.tensor([[0.0, 1 / 630 / 1.5, -0.03, 1.0]]).repeat(batch, 1)
    ground[-1] = float("nan")
    return torch.rand(batch, 3, height, width, generator=generator), radar, valid, ground


def make_network(name: str, architecture: dict[str, object], seed: int = 0) -> Network:
    torch.manual_seed(seed)
    network = networks.create(name, architecture)
    # As after some training: every return wins some pixels, and attention takes part.
    with torch.no_grad():
        for key, parameter in network.named_parameters():
            if key.endswith(("alpha", "beta")):
                parameter.fill_(0.5)
            if key.startswith("fusion.head.1"):
                parameter.normal_(std=0.1)
            if key.endswith(("point_head.bias", "association.head.bias")):
                parameter.add_(3.0)
            if key.endswith("expand.weight"):
                # So that returns differ: between returns that are all but equal, rounding decides who wins a pixel.
                parameter.mul_(30.0)
            if key in ("decoder.head.weight", "confidence.weight"):
                # Random layers, sixty of them, magnify what rounding left.
                parameter.mul_(0.02)
            if key == "class_decoder.head.bias":
                # One class for all: between classes that are all but equal, rounding decides.
                parameter[13] += 100.0
    if not isinstance(network, Baff | BaffPaper):
        # Deep encoders need norms that know what their maps are like: all pixels are but equal otherwise.
        for module in network.modules():
            if isinstance(module, torch.nn.BatchNorm2d):
                module.momentum = None
        with torch.no_grad():
            network.train()(*make_inputs(2, 64, 96, 9))
    return network.eval()


@pytest.fixture(scope="module", params=FORMS)
def network(request: pytest.FixtureRequest) -> Network:
    """One network of each form, which no test changes: to make them anew took most of the time."""
    return make_network(*FORMS[request.param])


@pytest.fixture(params=BAFF_FORMS)
def baff_form(request: pytest.FixtureRequest) -> tuple[str, dict[str, object]]:
    return BAFF_FORMS[request.param]


def tensors(outputs: object) -> Iterator[Tensor]:
    """All tensors within what `train_outputs` gave."""
    if isinstance(outputs, Tensor):
        yield outputs
    elif isinstance(outputs, tuple | list):
        for value in outputs:
            yield from tensors(value)


@pytest.mark.parametrize(("size", "count"), list(itertools.product(SIZES, COUNTS)))
def test_shapes_ranges_and_missing_values(network: Network, size: tuple[int, int], count: int) -> None:
    with torch.inference_mode():
        depths = network(*make_inputs(2, *size, count))
    for value in depths[:3]:
        assert value.shape == (2, 1, *size)
        assert value.dtype == torch.float32
    config = network.config
    assert ((depths.dense >= config.min_depth_m) & (depths.dense <= config.max_depth_m * 1.0001)).all()
    assert ((depths.confidence >= 0) & (depths.confidence <= 1)).all()
    assert not torch.isinf(depths.semi_dense).any()
    if count == 0:
        assert torch.isnan(depths.semi_dense).all()
    assert network.tells_classes(network.config) is (depths.classes is not None)
    if depths.classes is not None:
        assert depths.classes.shape == (2, 1, *size)
        assert depths.classes.dtype == torch.uint8
        assert int(depths.classes.max()) < len(CLASS_NAMES)


def test_semi_dense_depths_are_those_of_returns_within_their_regions(baff_form: tuple[str, dict[str, object]]) -> None:
    name, architecture = baff_form
    network = make_network(name, {**architecture, "threshold": 0.01})
    inputs = make_inputs(1, 64, 512, 6)
    with torch.inference_mode():
        semi_dense = network(*inputs).semi_dense[0, 0]
    covered = ~torch.isnan(semi_dense)
    assert covered.any()
    radar, valid = inputs[1][0], inputs[2][0]
    for value in semi_dense[covered].unique():
        owners = radar[valid & (radar[:, 2] == value)]
        assert len(owners) == 1, "a depth that no valid return has"
        columns = torch.nonzero((semi_dense == value).any(dim=0))
        assert (columns - owners[0, 0]).abs().max() <= 0.5 * network.config.region_width_px + 16


def test_padding_and_order_of_the_returns_do_not_matter(network: Network) -> None:
    image, radar, valid, ground = make_inputs(1, 64, 96, 9)
    order = torch.randperm(9, generator=torch.Generator().manual_seed(1))
    padded = torch.cat([radar[:, order], torch.full((1, 5, 6), 7.0)], dim=1)
    padded_valid = torch.cat([valid[:, order], torch.zeros(1, 5, dtype=torch.bool)], dim=1)
    with torch.inference_mode():
        expected = network(image, radar, valid, ground)
        got = network(image, padded, padded_valid, ground)
    for a, b in zip(expected, got, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-4, equal_nan=True)


def test_samples_of_a_batch_are_independent(network: Network) -> None:
    inputs = make_inputs(3, 64, 96, 5)
    with torch.inference_mode():
        together = network(*inputs)
        for index in range(3):
            alone = network(*(value[index : index + 1] for value in inputs))
            for a, b in zip(together, alone, strict=True):
                part = None if a is None else a[index : index + 1]
                torch.testing.assert_close(part, b, rtol=1e-4, atol=1e-4, equal_nan=True)


def test_training_reaches_every_parameter_with_finite_gradients(baff_form: tuple[str, dict[str, object]]) -> None:
    network = make_network(*baff_form).train()
    outputs = network.train_outputs(*make_inputs(2, 64, 96, 5))
    means = [value[torch.isfinite(value)].mean() for value in tensors(outputs) if value.requires_grad]
    torch.stack(means).sum().backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name


def test_association_and_candidates_have_depths(baff_form: tuple[str, dict[str, object]]) -> None:
    outputs = make_network(*baff_form).train().train_outputs(*make_inputs(2, 64, 96, 5))
    association, candidates = outputs.association, outputs.candidates
    assert association is not None
    shape = association.logits.shape
    trained = ~torch.isnan(association.depth_m.expand(shape))
    if association.columns is not None:
        assert association.columns.shape == (shape[0], shape[1], shape[3])
        trained &= (association.columns >= 0).unsqueeze(2)
    assert trained.any()
    if candidates is not None:
        assert candidates.logits.shape == candidates.depth_m.shape
        assert candidates.logits.shape[:2] == (2, CANDIDATES + DEPTH_BINS)


@pytest.mark.parametrize("count", [0, 7])
def test_training_and_inference_agree(network: Network, count: int) -> None:
    inputs = make_inputs(2, 64, 96, count)
    with torch.inference_mode():
        for a, b in zip(network(*inputs), network.train_outputs(*inputs).depths, strict=True):
            torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-4, equal_nan=True)


def test_script_equals_eager(network: Network) -> None:
    frozen = torchscript.freeze(network)
    for count in (0, 3, 17):
        inputs = make_inputs(1, 64, 96, count)
        with torch.inference_mode():
            expected = network(*inputs)
            # The first calls profile and specialise.
            for _ in range(3):
                for a, b in zip(expected, frozen(*inputs), strict=True):
                    torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-4, equal_nan=True)


@pytest.mark.exhaustive
@pytest.mark.timeout(400)  # the exporter takes its time, on a busy machine more
@pytest.mark.parametrize("network", FORMS, indirect=True)
def test_export_with_dynamic_height_width_and_number_of_returns(network: Network) -> None:
    height, width = (32 * torch.export.Dim(name, min=3, max=60) for name in ("height", "width"))
    count = torch.export.Dim("count", min=0, max=4096)
    # From 96 pixels on: torch.export takes a size of 1, which 64 pixels have at 1/64, for fixed.
    # torch's cache of operators costs a third of the time where almost each one has a size of its own.
    with warnings.catch_warnings(), torch._dynamo.config.patch(fake_tensor_cache_enabled=False):
        # Its own exporter still warns of its own internals.
        warnings.simplefilter("ignore")
        exported = torch.export.export(
            network,
            make_inputs(2, 128, 192, 20),
            dynamic_shapes={"image": {2: height, 3: width}, "radar": {1: count}, "valid": {1: count}, "ground": {}},
        ).module()
    for other in (make_inputs(2, 96, 160, 0), make_inputs(2, 96, 96, 33)):
        with torch.inference_mode():
            for a, b in zip(network(*other), exported(*other), strict=True):
                torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-4, equal_nan=True)


@pytest.mark.parametrize(
    "switches", list(itertools.product([False, True], repeat=3)), ids=lambda s: "".join("01"[on] for on in s)
)
def test_ablation_switches(switches: tuple[bool, bool, bool]) -> None:
    names = ("bidirectional", "channel_attention", "position_attention")
    network = make_network("baff", dict(zip(names, switches, strict=True)))
    with torch.inference_mode():
        dense = network(*make_inputs(1, 32, 64, 3)).dense
    assert torch.isfinite(dense).all()
    parts = ("bottom_up", "alpha", "beta")
    for part, on in zip(parts, switches, strict=True):
        assert any(part in key for key, _ in network.named_parameters()) == on


def test_without_the_ground_prior_the_road_is_ignored() -> None:
    network = make_network("baff", {"ground_prior": False})
    image, radar, valid, ground = make_inputs(1, 64, 96, 3)
    with torch.inference_mode():
        torch.testing.assert_close(
            network(image, radar, valid, ground).dense, network(image, radar, valid, ground * 2).dense
        )


@pytest.mark.parametrize(
    ("architecture", "message"),
    [
        ({"association": "magic"}, "association must be 'embedding' or 'regions', got 'magic'"),
        ({"region_width_px": 50}, "multiple of 32"),
        ({"min_depth_m": 10, "max_depth_m": 5}, "depth range"),
        ({"threshold": 1.5}, "threshold"),
        ({"fusion": "magic"}, "unknown key fusion"),
        ({"position_pool": [4]}, "position_pool needs 2 whole numbers"),
        ({"detail": 3}, "detail must be 1, 2 or 4, got 3"),
        ({"detail": 4}, "detail must be 2 with full_size: true, got 4"),
        ({"returns_per_cell": 0}, "at least 1"),
        ({"asociation": "regions"}, "did you mean association?"),
    ],
)
def test_architectures_that_cannot_be(architecture: dict[str, object], message: str) -> None:
    with pytest.raises(RadcamDepthError, match=message):
        networks.create("baff", architecture)


def test_an_unknown_network_is_refused_with_the_known_names() -> None:
    with pytest.raises(ArchitectureError, match=r"unknown network 'bafff'.*baff"):
        networks.create("bafff")


def test_a_thousand_returns_fit_in_two_gigabytes() -> None:
    """In a process of its own, whose peak memory is then the network's, with torch itself."""
    program = """
import re, torch
from pathlib import Path
from radcam_depth_ros import networks
torch.set_num_threads(1)
network = networks.create("baff").eval()
radar = torch.rand(1, 1000, 6) * torch.tensor([800.0, 448, 80, 20, 10, 0.1])
with torch.inference_mode():
    network(torch.rand(1, 3, 448, 800), radar, torch.ones(1, 1000, dtype=torch.bool), torch.full((1, 4), float("nan")))
# Not getrusage's maximum, which is inherited from the process that started this one.
print(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1])
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert int(run.stdout) * 1024 < 2e9


@pytest.mark.parametrize("part", ["association", "fusion"])
def test_parts_that_do_not_learn_have_no_loss(baff_form: tuple[str, dict[str, object]], part: str) -> None:
    network = make_network(*baff_form).train()
    # What stage 2 decides is for other parts, too, where there are some.
    others = ("road", "doubt", "sky", "mix") if part == "fusion" else ()
    for name in (part, *(other for other in others if getattr(network, other, None) is not None)):
        network.get_submodule(name).requires_grad_(False)
    outputs = network.train_outputs(*make_inputs(1, 64, 96, 3))
    assert (outputs.association is None) == (part == "association")
    assert (outputs.depths is None) == (outputs.confidence_logit is None) == (part == "fusion")


def test_a_pixel_knows_all_returns_where_there_are_few() -> None:
    """Which returns a cell considers must not matter where it can consider all of them."""
    few, many = (make_network("baff", {"returns_per_cell": count}) for count in (9, 40))
    inputs = make_inputs(1, 64, 96, 9)
    with torch.inference_mode():
        for a, b in zip(few(*inputs), many(*inputs), strict=True):
            torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-4, equal_nan=True)


@pytest.mark.parametrize("detail", [1, 2, 4])
def test_geometry_alone_is_what_an_idle_head_gives(detail: int) -> None:
    """With a head that always takes the first candidate: the flat road, and the returns where they are closer."""
    network = make_network("baff", {"detail": detail, "full_size": detail == 2})
    with torch.no_grad():
        network.get_parameter("fusion.head.1.weight").zero_()
        bias = network.get_parameter("fusion.head.1.bias").zero_()
        bias[2 * detail**2 : 3 * detail**2] = 50.0
    radar = torch.tensor([[[48.0, 40.0, 8.0, 5.0, 0.0, 0.0]]])
    ground = torch.tensor([[0.0, 1 / 630 / 1.5, 0.0, 1.0]])
    image = torch.rand(1, 3, 64, 96)
    with torch.inference_mode():
        beside = network(image, radar, torch.ones(1, 1, dtype=torch.bool), ground).dense[0, 0]
        alone = network(image, radar, torch.zeros(1, 1, dtype=torch.bool), ground).dense[0, 0]
    assert beside[40, 48] == pytest.approx(8.0, rel=1e-3)
    # The road at row 50 is 18.9 m away.
    assert alone[50, 48] == pytest.approx(630 * 1.5 / 50, rel=1e-2)


def test_depths_that_nothing_suggests_can_be_chosen() -> None:
    network = networks.create("baff", {"road": False}).eval()
    image, radar, valid, _ = make_inputs(1, 64, 96, 0)
    with torch.no_grad():
        network.get_parameter("fusion.head.1.bias")[-DEPTH_BINS + 4] = 20.0
        network.get_parameter("mix.head.bias")[:8] = -20.0
        depths = network(image, radar, valid, torch.full((1, 4), float("nan")))
    expected = plane_to_depth(torch.linspace(NEAREST_BIN, FARTHEST_BIN, DEPTH_BINS)[4], 1.0, 100.0)
    torch.testing.assert_close(depths.dense, expected.expand_as(depths.dense), rtol=1e-3, atol=0.0)


def test_semi_dense_depth_is_where_both_stages_are_sure_and_agree() -> None:
    # Pixels: agreed; nearer than any depth of stage 2; 20 % apart at 20 m, 5 % at 80 m, a third at 2 m; stage 1 unsure;
    # stage 2 unsure. A logit of 5 is 0.993.
    depth = torch.tensor([20.0, 0.5, 24.0, 84.0, 2.0, 20.0, 20.0]).reshape(1, 1, 1, 7)
    dense = torch.tensor([20.0, 1.0, 20.0, 80.0, 3.0, 20.0, 20.0]).repeat_interleave(2).reshape(1, 1, 1, 14)
    probability = torch.tensor([0.99, 0.99, 0.99, 0.99, 0.99, 0.01, 0.99]).reshape(1, 1, 1, 7)
    sure = torch.tensor([5.0, 5.0, 5.0, 5.0, 5.0, 5.0, -1.0]).repeat_interleave(2).reshape(1, 1, 1, 14)
    agreement = Agreement(threshold=0.5, min_depth_m=1.0)
    found = agreement(probability, depth, dense.expand(1, 1, 2, 14), sure.expand(1, 1, 2, 14)).flatten()
    assert found[:2].tolist() == [20.0, 0.5]
    assert torch.isnan(found[2:]).all()
