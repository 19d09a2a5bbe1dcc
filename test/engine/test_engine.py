from __future__ import annotations

import copy
import math
import threading
from contextlib import nullcontext

import pytest
import torch
from resident import resident_mib
from torch import Tensor, nn

from radcam_depth_ros import networks
from radcam_depth_ros.engine import MODES, PRECISIONS, Engine, EngineError, give_back_memory
from radcam_depth_ros.engine import engine as engine_module
from radcam_depth_ros.engine.calls import blank_frame
from radcam_depth_ros.engine.load import Load
from radcam_depth_ros.engine.sharing import ThreadBudget
from radcam_depth_ros.networks import Depths
from radcam_depth_ros.networks.weights_io import archive, torchscript
from radcam_depth_ros.networks.weights_io.folding import folded

Frame = tuple[Tensor, Tensor, Tensor]
FORMS: dict[str, tuple[str, dict[str, object]]] = {
    **{name: (name, {}) for name in networks.names() if name != "structured"},
    "regions": ("baff", {"association": "regions", "radar_map_size": [4, 5]}),
    # Not `seg`: between classes that are all but equal, rounding decides.
    "conf": ("structured", {"fusion": "conf", "backbone": "resnet18"}),
    "baff_paper": ("baff_paper", {"region_width_px": 96, "radar_map_size": [4, 5]}),
}


class Tiny(nn.Module):
    """Convolutions with and without batch norms, and what a network must do with its other inputs."""

    def __init__(self) -> None:
        super().__init__()
        self.first = nn.Sequential(nn.Conv2d(3, 8, 3, 2, 1, bias=False), nn.BatchNorm2d(8), nn.LeakyReLU(0.2))
        self.second = nn.Sequential(nn.Conv2d(8, 8, 3, 1, 1), nn.BatchNorm2d(8))
        self.head = nn.Conv2d(8, 1, 1)
        self.points = nn.Linear(6, 1)

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        maps = self.head(self.second(self.first(image)))
        near = (self.points(radar.to(image.dtype)).squeeze(2) * valid).sum(dim=1).reshape(-1, 1, 1, 1)
        semi_dense = (maps + near).float() + torch.nan_to_num(ground).sum()
        dense = nn.functional.interpolate(semi_dense, scale_factor=2.0, mode="nearest")
        return Depths(dense, semi_dense, torch.sigmoid(dense))


def tiny() -> Tiny:
    torch.manual_seed(0)
    network = Tiny()
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.uniform_(module.weight, 0.5, 1.5)
            nn.init.normal_(module.running_mean)
            nn.init.uniform_(module.running_var, 0.5, 2.0)
    return network.eval()


def frame(height: int = 64, width: int = 96, returns: int = 5) -> Frame:
    generator = torch.Generator().manual_seed(1)
    image = torch.randint(0, 256, (height, width, 3), dtype=torch.uint8, generator=generator)
    scale = torch.tensor([width, height, 60.0, 20.0, 10.0, 0.1])
    return image, torch.rand(returns, 6, generator=generator) * scale, torch.tensor([0.0, 1 / 945, -0.03, 1.0])


def reference(network: nn.Module, given: Frame) -> Depths:
    image, radar, ground = given
    with torch.inference_mode():
        pixels = image.permute(2, 0, 1).unsqueeze(0).float() / 255.0
        valid = torch.ones(1, len(radar), dtype=torch.bool)
        return Depths(*network(pixels, radar.unsqueeze(0), valid, ground.unsqueeze(0)))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("size", "returns"), [((64, 96), 5), ((32, 32), 0), ((96, 64), 130)])
def test_depth_is_that_of_the_network_whatever_the_size(mode: str, size: tuple[int, int], returns: int) -> None:
    network = tiny()
    engine = Engine(network, precision="float32", mode=mode)
    engine.warm_up(64, 96)
    given = frame(*size, returns)
    depths = engine.run(*given)
    for got, expected in zip(depths, reference(network, given), strict=True):
        torch.testing.assert_close(got, expected, rtol=1e-4, atol=1e-4)
    assert depths.dense.shape == (1, 1, *size)
    assert depths.semi_dense.shape == (1, 1, size[0] // 2, size[1] // 2)


def test_the_caller_s_network_stays_as_it_is() -> None:
    network = tiny().train()
    before = copy.deepcopy(network.state_dict())
    for mode in MODES:
        Engine(network, precision="bfloat16", mode=mode).run(*frame())
    assert network.training
    assert network.state_dict().keys() == before.keys()
    for name, value in network.state_dict().items():
        torch.testing.assert_close(value, before[name], rtol=0, atol=0)


@pytest.mark.parametrize("mode", MODES)
def test_bfloat16_is_near_and_comes_back_as_float32(mode: str) -> None:
    network, given = tiny(), frame()
    engine = Engine(network, precision="bfloat16", mode=mode)
    assert engine.precision == "bfloat16"
    for got, expected in zip(engine.run(*given)[:3], reference(network, given)[:3], strict=True):
        assert got.dtype == torch.float32
        torch.testing.assert_close(got, expected, rtol=0.05, atol=0.2)


@pytest.mark.parametrize(("name", "architecture"), FORMS.values(), ids=FORMS)
def test_every_network_runs_in_bfloat16(name: str, architecture: dict[str, object]) -> None:
    torch.manual_seed(0)
    network = networks.create(name, architecture).eval()
    assert {form for form, _ in FORMS.values()} == set(networks.names())
    engine = Engine(network, precision="bfloat16")
    for returns in (0, 9):
        given = frame(returns=returns)
        depths = engine.run(*given)
        assert {maps.dtype for maps in depths[:3]} == {torch.float32}
        torch.testing.assert_close(depths.dense, reference(network, given).dense, rtol=0.1, atol=0.1)


def test_later_frames_leave_earlier_results_alone() -> None:
    engine = Engine(tiny(), precision="float32")
    first = engine.run(*frame())
    kept = first.dense.clone()
    engine.run(*blank_frame(64, 96, 3))
    torch.testing.assert_close(first.dense, kept, rtol=0, atol=0)


def test_auto_is_float32_for_the_reference_and_one_of_both_else() -> None:
    assert Engine(tiny(), mode="eager").describe() == "float32 (the reference), eager"
    engine = Engine(tiny())
    assert engine.precision in PRECISIONS[1:]
    assert engine.describe().startswith(f"{engine.precision} (")


def test_an_export_runs_in_float32_and_refuses_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    network = tiny()
    exported = torchscript.freeze(network)
    engine = Engine(exported)
    assert engine.describe() == "float32 (as exported)"
    torch.testing.assert_close(engine.run(*frame()).dense, reference(network, frame()).dense, rtol=1e-4, atol=1e-4)
    with pytest.raises(EngineError, match=r"precision auto or float32 for an exported \.pt file.*got bfloat16"):
        Engine(exported, precision="bfloat16")
    monkeypatch.setattr(engine_module, "_usable", torch.device)
    with pytest.raises(EngineError, match=r"expected device cpu for an exported \.pt file.*got cuda"):
        Engine(exported, device="cuda")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"device": "warp"}, "device 'warp' cannot be used"),
        ({"precision": "float16"}, "precision must be one of auto, float32, bfloat16, got 'float16'"),
        ({"mode": "fast"}, "mode must be one of frozen, eager, got 'fast'"),
    ],
)
def test_what_cannot_be(values: dict[str, str], message: str) -> None:
    with pytest.raises(EngineError, match=message):
        Engine(tiny(), **values)


def test_a_size_is_warmed_up_once(monkeypatch: pytest.MonkeyPatch) -> None:
    engine = Engine(tiny(), precision="float32")
    seen: list[tuple[int, int]] = []
    monkeypatch.setattr(engine._calls, "warm_up", lambda height, width: seen.append((height, width)))
    for size in ((64, 96), (64, 96), (32, 64), (64, 96)):
        engine.warm_up(*size)
    assert seen == [(64, 96), (32, 64)]


def test_the_first_size_is_run_twice_and_each_other_once_in_the_calling_thread(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    engine = Engine(tiny(), precision="float32")
    run, seen = engine._calls.run, []

    def noted(image: torch.Tensor, *others: torch.Tensor) -> Depths:
        seen.append((*image.shape[:2], threading.current_thread()))
        return run(image, *others)

    monkeypatch.setattr(engine._calls, "run", noted)
    for size in ((64, 96), (64, 96), (32, 64), (64, 96), (32, 96)):
        engine.warm_up(*size)
    here = threading.current_thread()
    assert seen == [(64, 96, here), (64, 96, here), (32, 64, here), (32, 96, here)]


def test_batch_norms_are_folded_before_weights_are_rounded() -> None:
    network = tiny()
    ready = folded(network, torch.bfloat16)
    assert not any(isinstance(module, nn.BatchNorm2d) for module in ready.modules())
    assert ready.head.weight.is_contiguous(memory_format=torch.channels_last)
    norm = network.first[1]
    gain = (norm.weight / (norm.running_var + norm.eps).sqrt()).reshape(-1, 1, 1, 1)
    torch.testing.assert_close(ready.first[0].weight, (network.first[0].weight * gain).bfloat16(), rtol=0, atol=0)


def test_loading_a_network_leaves_no_copies_of_it_and_dropping_it_nothing() -> None:
    give_back_memory()
    before = resident_mib()
    network = networks.create("cafnet")
    weights_mib = sum(value.nbytes for value in network.parameters()) / 2**20
    engine = Engine(network, precision="float32")
    assert resident_mib() - before < 3.5 * weights_mib
    del engine, network
    give_back_memory()
    assert resident_mib() - before < 0.5 * weights_mib


class Counting(Tiny):
    """Notes the number of threads that it is run with; fails when told to."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[int] = []
        self.fails = False

    def __deepcopy__(self, memo: dict[int, object]) -> Counting:
        return self

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        self.seen.append(torch.get_num_threads())
        if self.fails:
            raise RuntimeError("no memory")
        return super().forward(image, radar, valid, ground)


class Budget:
    """Says numbers of threads one after the other, in place of `ThreadBudget`."""

    def __init__(self, *threads: int) -> None:
        self._threads = list(threads)
        self.ended = 0

    def begin(self) -> int:
        return self._threads.pop(0)

    def end(self) -> None:
        self.ended += 1


def counting_engine(monkeypatch: pytest.MonkeyPatch, threads: int, cores: int = 4) -> tuple[Counting, Engine]:
    """An engine of a frozen network as Python, so that it can look around."""
    monkeypatch.setattr(torchscript, "freeze", lambda network, dtype: network)
    monkeypatch.setattr(engine_module, "usable_cores", lambda: cores)
    network = Counting().eval()
    return network, Engine(network, precision="float32", threads=threads)


def run_one(network: Counting, engine: Engine, *, fails: bool) -> None:
    network.fails = fails
    with pytest.raises(RuntimeError, match="no memory") if fails else nullcontext():
        engine.run(*frame())


def test_a_frame_takes_the_threads_of_the_budget_and_leaves_torchs(monkeypatch: pytest.MonkeyPatch) -> None:
    torch.set_num_threads(4)
    network, engine = counting_engine(monkeypatch, threads=0)
    budget = Budget(4, 1, 3, 2)
    monkeypatch.setattr(engine, "_budget", budget)
    for fails in (False, False, True, False):
        run_one(network, engine, fails=fails)
        assert torch.get_num_threads() == 4
    assert (network.seen, budget.ended) == ([4, 1, 3, 2], 4)


def test_beside_other_work_an_engine_takes_fewer_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three of four cores are busy with others, and the threads wait for them."""
    ticks = iter(range(1000))

    def now() -> Load:
        at_s = 0.2 * next(ticks)
        return Load(at_s, 4.0 * at_s, at_s, at_s)

    monkeypatch.setattr(engine_module, "ThreadBudget", lambda most, cores: ThreadBudget(most, cores, now))
    torch.set_num_threads(4)
    network, engine = counting_engine(monkeypatch, threads=0)
    for _ in range(5):
        engine.run(*frame())
    assert network.seen == [4, 1, 1, 1, 1]
    assert torch.get_num_threads() == engine.threads == 4


@pytest.mark.parametrize(("torchs", "cores", "expected"), [(4, 2, 2), (2, 4, 2), (1, 4, 1)])
def test_threads_of_its_own_choice_are_torchs_but_no_more_than_cores(
    monkeypatch: pytest.MonkeyPatch, torchs: int, cores: int, expected: int
) -> None:
    torch.set_num_threads(torchs)
    monkeypatch.setattr(Load, "now", lambda: Load(0.0, math.nan, 0.0, math.nan))
    network, engine = counting_engine(monkeypatch, 0, cores)
    engine.run(*frame())
    assert network.seen == [engine.threads] == [expected]
    assert torch.get_num_threads() == torchs


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_a_given_number_of_threads_is_taken_whatever_else_runs(monkeypatch: pytest.MonkeyPatch, threads: int) -> None:
    network, engine = counting_engine(monkeypatch, threads, cores=2)
    for fails in (False, True):
        run_one(network, engine, fails=fails)
        assert torch.get_num_threads() == 1
    assert network.seen == [threads] * 2
    assert engine.threads == threads


@pytest.mark.parametrize("precision", PRECISIONS[1:])
def test_baffs_depth_is_the_same_in_one_thread_and_in_two_but_for_rounding(
    precision: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that a node on two cores gives the same depth whatever else runs on the computer.

    oneDNN sums up the widest layers of ImageNet's features in parts that go by the number of threads.
    """
    engine = Engine(archive.load("baff").network, precision=precision)
    monkeypatch.setattr(engine, "_budget", Budget(1, 2, 1))
    given = frame(224, 416, 60)  # large enough for torch's group norm to differ
    one, *others = (engine.run(*given) for _ in range(3))
    assert torch.isfinite(one.dense).all()
    for other in others:
        for expected, result in zip(one[:3], other[:3], strict=True):
            if precision == "float32":
                torch.testing.assert_close(result, expected, rtol=2e-5, atol=2e-5, equal_nan=True)
            else:
                known = torch.isfinite(result) & torch.isfinite(expected)
                assert float((torch.isfinite(result) != torch.isfinite(expected)).float().mean()) < 0.01
                apart = (result - expected).abs()[known] / expected.abs()[known]
                assert float(apart.quantile(0.95)) < 0.01
