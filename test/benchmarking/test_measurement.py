from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from radcam_depth_ros.benchmarking import comparison, machine, measurement, memory
from radcam_depth_ros.benchmarking.comparison import Against
from radcam_depth_ros.benchmarking.measurement import measure
from radcam_depth_ros.benchmarking.rotation import Schedule
from radcam_depth_ros.benchmarking.sections import count_gflop, dissect
from radcam_depth_ros.benchmarking.subject import BenchmarkError, NetworkInputs, Running, Size, Subject
from radcam_depth_ros.networks import names, registry
from radcam_depth_ros.networks.weights_io import archive, torchscript

SIZE = Size(32, 64, 5)
PIXELS = 32 * 64


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small probes, short turns, and no other processes: they do not know the tiny network."""
    monkeypatch.setattr(machine, "CONVOLUTIONS", ((8, 16, 16),))
    monkeypatch.setattr(machine, "PRODUCT", 32)
    monkeypatch.setattr(comparison, "TURN_S", 0.0)
    for module in (measurement, comparison):
        monkeypatch.setattr(module, "process_peak_mb", lambda subject, size: float(size.points + 100))


def watch(what: str, done: int, total: int) -> None:
    assert what
    assert 0 <= done <= total


def gflop_of_tiny(width: int) -> dict[str, float]:
    tokens = PIXELS // 256
    return {
        "encoder": 2e-9 * 27 * width * PIXELS,
        "attention": 2e-9 * 2 * tokens * tokens * width,
        "heads": 2e-9 * (width + 1) * PIXELS,
    }


@pytest.mark.parametrize("mode", ["frozen", "eager"])
def test_stages_are_counted_and_run(tiny: str, mode: str) -> None:
    running = Running.start(Subject(tiny, mode=mode))
    inputs = NetworkInputs.synthetic(SIZE, running.focal_length_px)
    anatomy = dissect(running, inputs)
    assert [section.name for section in anatomy.sections] == ["encoder", "attention", "heads", "heads"]
    expected = gflop_of_tiny(8)
    for name, gflop in expected.items():
        assert sum(section.gflop for section in anatomy.sections if section.name == name) == pytest.approx(gflop)
    assert anatomy.gflop == pytest.approx(sum(expected.values())) == count_gflop(running, inputs)
    encoder = anatomy.sections[0]
    assert encoder.task.call().shape == (1, 8, 32, 64)
    # Its output is held at least, and a handful of such maps at most.
    assert 8 * PIXELS * 4 / 2**20 <= encoder.peak_memory_mb < 1


def test_stages_that_an_architecture_lacks_are_left_out(tiny: str) -> None:
    running = Running.start(Subject(tiny, architecture={"has_tail": False}))
    assert [path for _, path in running.loaded.sections] == ["encoder", "attention", "head"]


def test_an_exported_network_is_one_piece(tmp_path: Path, small_weights: Path) -> None:
    path = tmp_path / "baff.pt"
    torchscript.export(archive.load(small_weights), path)
    running = Running.start(Subject(model_file=str(path)))
    anatomy = dissect(running, NetworkInputs.synthetic(SIZE, running.focal_length_px))
    assert not anatomy.sections
    assert anatomy.gflop > 0


@pytest.mark.parametrize("name", names())
def test_each_stage_of_the_networks_is_there_and_called_once(name: str) -> None:
    found: set[tuple[str, str]] = set()
    kind = registry.find(name)
    grown = {key: True for key, value in kind.grows.items() if value is False}
    for architecture in ({}, grown, {} if kind.paper_network else kind.paper):
        running = Running.start(Subject(name, architecture=architecture, mode="eager"))
        network, sections = running.loaded.network, running.loaded.sections
        found.update(sections)
        calls: list[str] = []
        for _, path in sections:
            network.get_submodule(path).register_forward_pre_hook(lambda *_, path=path, calls=calls: calls.append(path))
        network(torch.zeros(1, 3, 32, 32), torch.ones(1, 2, 6), torch.ones(1, 2).bool(), torch.zeros(1, 4))
        assert calls == [path for _, path in sections]
    assert found == set(registry.find(name).sections)


@pytest.mark.parametrize("name", names())
def test_the_papers_form_can_be_built(name: str) -> None:
    paper, name = registry.find(name).paper, registry.find(name).paper_network or name
    loaded = Running.start(Subject(name, architecture=paper, mode="eager")).loaded
    config = loaded.network.config
    assert {key: getattr(config, key) for key in paper} == dict(paper)
    is_shipped = archive.shipped(name).is_file() and archive.load(name).network.config == config
    assert loaded.weights.split(":")[0] == ("shipped" if is_shipped else "random")


@pytest.mark.usefixtures("quick")
def test_everything_is_measured(tiny: str) -> None:
    sizes = [SIZE, Size(64, 64, 0)]
    report = measure(Subject(tiny, precision="float32"), sizes, Schedule(3), watch)
    values = json.loads(json.dumps(report.as_json(), allow_nan=False))
    assert values["machine"]["threads"] == torch.get_num_threads()
    assert values["machine"]["cpu"]
    assert set(values["machine"]["best_gflops"]["float32"]) == {"convolution", "matrix_product"}
    assert (values["network"], values["precision"]) == ("tiny", "float32")
    assert values["weights"].startswith("random: the weights of 'tiny' are not installed")
    assert (values["threads"], values["weights_sha256"]) == (torch.get_num_threads(), "")
    assert values["against"] is None
    assert [(row["height"], row["width"], row["points"]) for row in values["sizes"]] == [(32, 64, 5), (64, 64, 0)]
    row = values["sizes"][0]
    assert row["rounds"] == 3
    assert row["peak_memory_mb"] == 105.0
    assert row["frames_per_s"] == pytest.approx(1e3 / row["median_ms"], rel=1e-3)
    best = values["machine"]["best_gflops"]["float32"]["convolution"]
    assert row["share_of_best"] == pytest.approx(1e3 * row["gflop"] / row["median_ms"] / best, rel=1e-3)
    around = ["resample", "encoder", "attention", "heads", "the rest", "resample back"]
    assert [section["name"] for section in row["stages"]] == around
    assert row["stages"][1]["gflop"] == pytest.approx(gflop_of_tiny(8)["encoder"], rel=1e-3)
    assert row["stages"][0]["gflop"] is None


@pytest.mark.usefixtures("quick")
def test_two_precisions_share_weights_and_their_depth_is_compared(tiny: str) -> None:
    subject = Subject(tiny, precision="bfloat16")
    against = Against("precision=float32", Subject(tiny, precision="float32"))
    report = measure(subject, [SIZE], Schedule(3), watch, against)
    assert report.against is not None
    (pair,) = report.against.pairs
    assert len(pair.ratios) == 3
    assert 0 < pair.depth_difference < 0.05
    values = report.as_json()["against"]
    assert (values["spec"], values["precision"]) == ("precision=float32", "float32")
    ratio = values["sizes"][0]["ratio"]
    assert ratio["median"] == pytest.approx(pair.quantile(0.5), rel=1e-3)
    assert len(ratio["pairs"]) == 3
    assert ratio["of_fastest"] > 0
    assert values["sizes"][0]["subject"]["gflop"] == values["sizes"][0]["other"]["gflop"]


@pytest.mark.usefixtures("quick")
def test_another_architecture_at_another_size(tiny: str) -> None:
    other = Subject(tiny, architecture={"width": 16}, mode="eager", precision="float32")
    report = measure(Subject(tiny), [SIZE], Schedule(2), watch, Against("paper", other, image_factor=2, points=9))
    assert report.against is not None
    (pair,) = report.against.pairs
    assert pair.other.size == Size(64, 128, 9)
    assert pair.other.gflop > 4 * pair.subject.gflop
    assert math.isnan(pair.depth_difference)
    assert report.as_json()["against"]["sizes"][0]["memory_ratio"] == pytest.approx(109 / 105, rel=1e-3)


def test_memory_of_a_process_grows_with_the_image(small_weights: Path) -> None:
    subject = Subject(model_file=str(small_weights), precision="float32", mode="eager", threads=1)
    small, large = (memory.process_peak_mb(subject, Size(side, side, 1)) for side in (32, 512))
    assert 50 < small < large


def test_a_process_that_fails_is_told_in_a_sentence() -> None:
    with pytest.raises(BenchmarkError, match="the process that measures memory at 32 x 64, 5 points failed: "):
        memory.process_peak_mb(Subject(model_file="nowhere.safetensors"), SIZE)


def test_weights_are_shipped_or_random(small_weights: Path) -> None:
    file = str(small_weights)
    assert Subject(model_file=file).load().weights == file
    same = {"association": "embedding", "position_pool": [16, 8]}
    assert Subject(model_file=file, architecture=same).load().weights == file
    loaded = Subject(model_file=file, architecture={"embedding_dims": 16}).load()
    assert loaded.weights == "random"
    assert loaded.archive.card.architecture["embedding_dims"] == 16
    again = Subject(model_file=file, architecture={"embedding_dims": 16}).load()
    for value, other in zip(loaded.network.parameters(), again.network.parameters(), strict=True):
        assert torch.equal(value, other)


def test_shipped_weights_of_an_earlier_architecture_are_not_taken(
    tiny: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    network = registry.create(tiny)
    path = tmp_path / "tiny.safetensors"
    card = archive.Card.of(network, tiny, "nothing")
    archive.save(network, card, path)
    monkeypatch.setattr(archive, "shipped", lambda name: path)
    assert Subject(tiny).load().weights == "shipped"
    path.write_bytes(path.read_bytes().replace(b"width:", b"waist:"))
    assert Subject(tiny).load().weights.startswith("random: ")


@pytest.mark.parametrize("subject", [Subject("nonsense"), Subject(model_file="nowhere.safetensors")])
def test_what_is_not_there_cannot_be_loaded(subject: Subject) -> None:
    with pytest.raises(archive.ArchiveError, match="no weight file at"):
        subject.load()


def test_inputs_are_always_the_same() -> None:
    first, second = (NetworkInputs.synthetic(SIZE, 630.0).as_tuple() for _ in range(2))
    for value, other in zip(first, second, strict=True):
        assert torch.equal(value, other)
    image, radar, ground = first
    assert (image.shape, image.dtype) == ((32, 64, 3), torch.uint8)
    assert (radar.shape, ground.shape) == ((5, 6), (4,))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Size(33, 64, 1), "multiples of 32, got 33 x 64"),
        (lambda: Size(32, 64, -1), "must not be negative, got -1"),
        (lambda: Subject(precision="float8"), "precision must be one of auto, float32, bfloat16, got 'float8'"),
        (lambda: Subject(mode="fast"), "mode must be one of frozen, eager, got 'fast'"),
        (lambda: Subject(threads=-1), "threads must be 0"),
        (lambda: Schedule(0), "must be positive, got 0 rounds"),
    ],
)
def test_what_cannot_be_measured(make: Callable[[], object], message: str) -> None:
    with pytest.raises(BenchmarkError, match=message):
        make()


def test_sizes_are_padded_as_the_estimator_does_it() -> None:
    assert Size.padded(900, 1600, 60) == Size(928, 1600, 60)
