"""ONNX files: their export, what is refused, and how the engine and the estimator run them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from command_line import run_main
from torch import Tensor, nn

from radcam_depth_ros import networks
from radcam_depth_ros.engine import Engine, EngineError
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.frame import CameraModel, Frame, RadarReturns
from radcam_depth_ros.networks import Depths, registry
from radcam_depth_ros.networks.interface import Network
from radcam_depth_ros.networks.weights_io import archive, onnx_export, onnx_file, torchscript
from radcam_depth_ros.networks.weights_io.archive import Archive, ArchiveError, Card

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")
pytest.importorskip("onnxscript")

HEIGHT, WIDTH = 64, 96
SHIPPED = ("baff", "structured", "lircdepth")


class Small(Network):
    """A few operators of each kind: a network whose export takes seconds."""

    about = "for tests"
    config_type = networks.NetworkConfig

    def __init__(self, config: Any) -> None:
        super().__init__(config)
        self.look = nn.Sequential(nn.Conv2d(3, 8, 3, 1, 1, bias=False), nn.BatchNorm2d(8), nn.LeakyReLU(0.2))
        self.head = nn.Conv2d(8, 2, 1)

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        maps = self.head(self.look(image))
        confidence, plane = torch.sigmoid(maps[:, :1]), torch.sigmoid(maps[:, 1:])
        radar = nn.functional.pad(radar, (0, 0, 0, 2), value=50.0)
        nearest = torch.where(nn.functional.pad(valid, (0, 2), value=False), radar[:, :, 2], 50.0).amin(dim=1)
        nearest = nearest.reshape(-1, 1, 1, 1)
        dense = 1.0 + plane * nearest + torch.nan_to_num(ground).abs().sum()
        semi_dense = torch.where(confidence > 0.5, nearest.expand_as(dense), float("nan"))
        return Depths(dense, semi_dense, confidence, None, plane)


@pytest.fixture(scope="module", autouse=True)
def _registered() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(registry._NETWORKS, "small", Small)
        yield


@pytest.fixture(scope="module")
def given() -> Archive:
    torch.manual_seed(0)
    network = networks.create("small").eval()
    return Archive(network, Card.of(network, "small", "nothing"))


@pytest.fixture(scope="module")
def exported(given: Archive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("onnx") / "small.onnx"
    onnx_export.export(given, path, HEIGHT, WIDTH)
    return path


def changed(exported: Path, change: Callable[[Any], object], target: Path) -> Path:
    """A file whose model is another, with the SHA-256 that fits."""
    model = onnx.load_model_from_string(exported.read_bytes())
    del model.metadata_props[1:]
    change(model)
    target.write_bytes(onnx_file.seal(model.SerializeToString()))
    return target


def test_the_engine_runs_a_file_as_its_network(given: Archive, exported: Path) -> None:
    loaded = archive.load(exported)
    assert loaded.card == given.card
    assert loaded.is_export
    engine, reference = Engine(loaded.network, threads=1), Engine(given.network, mode="eager")
    assert engine.describe().startswith("float32 (as exported), onnxruntime ")
    assert engine.only_size == (HEIGHT, WIDTH)
    engine.warm_up(HEIGHT, WIDTH)
    for returns in (0, 1, 60, 1000):
        frame = onnx_export.made_up_frame(HEIGHT, WIDTH, returns)
        found, expected = engine.run(*frame), reference.run(*frame)
        assert found.classes is None
        for mine, theirs in zip((*found[:3], found.sky), (*expected[:3], expected.sky), strict=True):
            torch.testing.assert_close(mine, theirs, rtol=0, atol=1e-4, equal_nan=True)


def test_rows_without_depth_are_padding(exported: Path) -> None:
    image, radar, ground = onnx_export.made_up_frame(HEIGHT, WIDTH, 5)
    engine = Engine(archive.load(exported).network, threads=1)
    padded = torch.cat([radar, torch.zeros(3, 6)])
    assert torch.equal(engine.run(image, padded, ground).dense, engine.run(image, radar, ground).dense)


def test_the_estimator_gives_the_depth_of_the_weights(given: Archive, exported: Path) -> None:
    focal_px = given.card.focal_length_px
    camera = CameraModel(WIDTH - 6, HEIGHT - 4, focal_px, focal_px, 44.0, 30.0)
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (camera.height, camera.width, 3), np.uint8)
    frame = Frame(0, "camera", image, camera, RadarReturns.from_points([[0.0, 0.0, 20.0]]))
    estimator = Estimator(EstimatorConfig(model_file=str(exported), allow_exported=True, threads=1))
    found, expected = estimator.estimate(frame), Estimator(EstimatorConfig(precision="float32"), given).estimate(frame)
    np.testing.assert_allclose(found.dense, expected.dense, atol=1e-3)
    assert "onnxruntime" in estimator.describe()
    assert len(estimator.computation.weights_sha256) == 64


def test_a_file_tells_nothing_of_this_computer(exported: Path) -> None:
    content = exported.read_bytes()
    for word in (str(Path(__file__).parents[3]), sys.prefix, "site-packages", "radcam_depth_ros/"):
        assert word.encode() not in content


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"precision": "bfloat16"}, "expected precision other than bfloat16 for an ONNX file"),
        ({"mode": "eager"}, "expected mode other than eager for an ONNX file"),
        ({"device": "warp"}, "expected device cpu or cuda for an ONNX file, got 'warp'"),
        ({"runtime": "vulkan"}, "runtime must be one of auto, cpu, cuda, tensorrt, got 'vulkan'"),
        ({"runtime": "tensorrt"}, r"needs onnxruntime's TensorrtExecutionProvider, .* set runtime to cpu"),
        ({"device": "cuda:1"}, r"runtime cuda needs onnxruntime's CUDAExecutionProvider.* has CPUExecutionProvider;"),
    ],
)
def test_what_an_engine_refuses(
    values: dict[str, str], message: str, exported: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("onnxruntime.get_available_providers", lambda: ["CPUExecutionProvider"])
    with pytest.raises(EngineError, match=message):
        Engine(archive.load(exported).network, threads=1, **values)


def test_a_provider_that_cannot_be_started_is_told(exported: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "onnxruntime.get_available_providers", lambda: ["CUDAExecutionProvider", "CPUExecutionProvider"]
    )
    open_session = onnx_file.open_session
    monkeypatch.setattr(
        "radcam_depth_ros.engine.onnx_calls.open_session",
        lambda network, providers, threads: open_session(network, providers[-1:], threads),
    )
    with pytest.raises(EngineError, match="CUDAExecutionProvider could not be started here"):
        Engine(archive.load(exported).network, runtime="cuda", threads=1)


def test_runtime_is_for_onnx_files_and_an_image_of_another_size_is_refused(given: Archive, exported: Path) -> None:
    with pytest.raises(EngineError, match="expected runtime auto for weights that torch runs, got tensorrt"):
        Engine(given.network, runtime="tensorrt")
    with pytest.raises(EngineError, match=r"expected an image of 64 x 96 .* got 32 x 96; .*--size 32x96"):
        Engine(archive.load(exported).network, threads=1).run(*onnx_export.made_up_frame(32, WIDTH, 3))


def test_the_rules_of_exports_hold(exported: Path) -> None:
    with pytest.raises(ArchiveError, match="allow_exported is false"):
        archive.load(exported, allow_exported=False)
    with pytest.raises(ArchiveError, match="not among trusted_models"):
        archive.load(exported, trusted=["0" * 64])


def test_a_changed_byte_is_told(exported: Path, tmp_path: Path) -> None:
    content = exported.read_bytes()
    for place in np.random.default_rng(0).integers(0, len(content), 40):
        damaged = bytearray(content)
        damaged[place] ^= 1
        (tmp_path / "damaged.onnx").write_bytes(damaged)
        with pytest.raises(ArchiveError, match=r"SHA-256|no ONNX file"):
            archive.load(tmp_path / "damaged.onnx")
    for size in (0, 1, 76, len(content) // 2, len(content) - 1, len(content) - 76):
        (tmp_path / "cut.onnx").write_bytes(content[:size])
        with pytest.raises(ArchiveError, match=r"SHA-256|no ONNX file|another model"):
            archive.load(tmp_path / "cut.onnx")


def test_a_file_of_another_model_is_told(tmp_path: Path) -> None:
    value = onnx.helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, [1])
    graph = onnx.helper.make_graph([onnx.helper.make_node("Relu", ["x"], ["y"])], "g", [value], [])
    path = tmp_path / "other.ONNX"
    path.write_bytes(onnx.helper.make_model(graph).SerializeToString())
    with pytest.raises(ArchiveError, match=r"other\.ONNX is an ONNX file of another model.*radcam-depth export"):
        archive.load(path)
    path.write_bytes(b"PK\x03\x04 nothing")
    with pytest.raises(ArchiveError, match="is no ONNX file that can be read"):
        archive.load(path)


def _external(model: Any) -> None:
    tensor = model.graph.initializer[0]
    tensor.data_location = onnx.TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/passwd")


def _external_constant(model: Any) -> None:
    node = onnx.helper.make_node("Constant", [], ["z"], value=onnx.helper.make_tensor("z", 1, [1], [0.0]))
    node.attribute[0].t.external_data.add(key="location", value="weights.bin")
    model.graph.node.append(node)


def _rename(model: Any) -> None:
    model.graph.node[0].op_type = "StringConcat"


def _own_domain(model: Any) -> None:
    model.graph.node[0].domain = "com.microsoft"


def _function(model: Any) -> None:
    model.functions.add(name="f", domain="own")


def _settings(model: Any) -> None:
    model.metadata_props.add(key="ort_config", value="{}")


def _another_input(model: Any) -> None:
    model.graph.input[1].type.tensor_type.shape.dim[1].dim_value = 7


def _fewer_outputs(model: Any) -> None:
    del model.graph.output[1]


def _branch(model: Any) -> None:
    model.graph.node[0].attribute.add(name="then_branch", type=onnx.AttributeProto.GRAPH).g.name = "inner"


def _dangling(model: Any) -> None:
    model.graph.node[-1].input[0] = "nothing"


def _no_card(model: Any) -> None:
    del model.metadata_props[:]


def _short_tensor(model: Any) -> None:
    tensor = next(tensor for tensor in model.graph.initializer if len(tensor.raw_data) > 8)
    tensor.raw_data = tensor.raw_data[:-4]


def _other_channels(model: Any) -> None:
    tensor = next(tensor for tensor in model.graph.initializer if tensor.dims[:] == [8, 3, 3, 3])
    tensor.dims[:] = [8, 9, 3, 1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_external, "one of its tensors is in another file"),
        (_external_constant, "one of its tensors is in another file"),
        (_rename, "operator ':StringConcat'"),
        (_own_domain, "operator 'com.microsoft:"),
        (_function, "operators of its own"),
        (_settings, "its metadata has more"),
        (_another_input, "its inputs have the shapes"),
        (_fewer_outputs, "its outputs are"),
        (_branch, "has a graph of its own"),
        (_dangling, "it is no valid model"),
        (_short_tensor, "it is no valid model"),
        (_no_card, "another model"),
    ],
)
def test_what_is_not_as_exports_are_is_refused(
    change: Callable[[Any], None], message: str, exported: Path, tmp_path: Path
) -> None:
    with pytest.raises(ArchiveError, match=message):
        archive.load(changed(exported, change, tmp_path / "hostile.onnx"))


def test_what_onnxruntime_refuses_is_told(exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded = archive.load(changed(exported, _other_channels, tmp_path / "other.onnx"))
    with pytest.raises(EngineError, match=r"onnxruntime (cannot run|failed).* on cpu: .*"):
        Engine(loaded.network, threads=1).run(*onnx_export.made_up_frame(HEIGHT, WIDTH, 3))

    def refuse(*_: object) -> None:
        raise RuntimeError("no such operator\nand more")

    monkeypatch.setattr("radcam_depth_ros.engine.onnx_calls.open_session", refuse)
    with pytest.raises(EngineError, match=r"cannot run the ONNX file on cpu: no such operator; .*radcam-depth export"):
        Engine(loaded.network, threads=1)


@pytest.mark.parametrize("package", ["onnx", "onnxruntime"])
def test_a_missing_package_is_named_with_its_extra(
    package: str, exported: Path, given: Archive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ArchiveError, match=f"needs the package {package}, which is not installed; .*extra `onnx`"):
        archive.load(exported)
    with pytest.raises(ArchiveError, match=f"an export to ONNX needs the package {package}"):
        onnx_export.export(given, tmp_path / "small.onnx", HEIGHT, WIDTH)


def test_an_export_that_differs_is_not_written(
    given: Archive, exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = onnx.load_model_from_string(exported.read_bytes())
    del model.metadata_props[:]
    weights = next(tensor for tensor in model.graph.initializer if tensor.dims[:] == [8, 3, 3, 3])
    weights.raw_data = (np.frombuffer(weights.raw_data, np.float32) * 1.01).tobytes()
    monkeypatch.setattr(onnx_export, "_translated", lambda *_: model)
    with pytest.raises(ArchiveError, match=r"expected dense of the ONNX file within 0\.001 .* nothing was written"):
        onnx_export.export(given, tmp_path / "small.onnx", HEIGHT, WIDTH)
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_exported(given: Archive, tmp_path: Path) -> None:
    with pytest.raises(ArchiveError, match=r"expected an opset from 18 to 23, got 9"):
        onnx_export.export(given, tmp_path / "small.onnx", HEIGHT, WIDTH, 9)
    frozen = Archive(torchscript.freeze(given.network), given.card)
    with pytest.raises(ArchiveError, match="got an exported file"):
        onnx_export.export(frozen, tmp_path / "small.onnx", HEIGHT, WIDTH)


def test_the_verb_refuses_sizes_of_torchscript_files_and_sizes_that_are_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments in ((tmp_path / "a.pt", "--size", "64x96"), (tmp_path / "a.pt", "--opset", 18)):
        assert run_main(monkeypatch, "export", *arguments) == 2
        assert "are for .onnx files, got a.pt" in capsys.readouterr().err
    assert run_main(monkeypatch, "export", tmp_path / "a.onnx", "--size", "big") == 2
    assert "a size is HEIGHTxWIDTH" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.exhaustive
@pytest.mark.timeout(3600)  # the exporter takes its time, on a busy machine more
@pytest.mark.parametrize("size", [(224, 416), (448, 800)], ids=lambda size: f"{size[0]}x{size[1]}")
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_networks_give_the_same_depth_by_onnxruntime(name: str, size: tuple[int, int], tmp_path: Path) -> None:
    given = archive.load(name)
    onnx_export.export(given, tmp_path / "network.onnx", *size)
    engine = Engine(archive.load(tmp_path / "network.onnx").network)
    reference = Engine(given.network, precision="float32")
    for returns in (0, 60, 1000):
        frames = [onnx_export.made_up_frame(*size, returns, number) for number in range(onnx_export.TRIES)]
        same = sum(gives_the_same(engine, reference, frame) for frame in frames)
        assert 2 * same > len(frames), f"{returns} returns"


def gives_the_same(engine: Engine, reference: Engine, frame: tuple[torch.Tensor, ...]) -> bool:
    pairs = zip(engine.run(*frame), reference.run(*frame), strict=True)
    shares = [
        onnx_export.differing_share(theirs, mine) for mine, theirs in pairs if not (mine is None or theirs is None)
    ]
    return max(shares) <= onnx_export.DECIDED_SHARE


@pytest.mark.parametrize("wrong", [1, 2])
def test_an_export_may_differ_where_rounding_decides_on_one_frame_but_not_on_two(
    given: Archive, exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: int
) -> None:
    honest, calls = onnx_export.differing_share, []
    # The dense depth is the first output of each frame.
    outputs = len(archive.load(exported).network.outputs)  # type: ignore[arg-type]  # an OnnxNetwork's names
    differs = {outputs * frame for frame in range(wrong)}

    def share(expected: object, found: object) -> float:
        calls.append(found)
        return 0.5 if len(calls) - 1 in differs else honest(expected, found)

    monkeypatch.setattr(onnx_export, "differing_share", share)
    if wrong == 1:
        onnx_export.export(given, tmp_path / "small.onnx", HEIGHT, WIDTH)
    else:
        with pytest.raises(ArchiveError, match=r"expected dense .* got 50 % of the pixels that differ more"):
            onnx_export.export(given, tmp_path / "small.onnx", HEIGHT, WIDTH)
    assert (tmp_path / "small.onnx").exists() == (wrong == 1)
