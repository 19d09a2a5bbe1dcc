from __future__ import annotations

import gc
import hashlib
from pathlib import Path

import pytest
import torch
import yaml
from safetensors.torch import load_file, save_file
from torch.multiprocessing.reductions import StorageWeakRef

from radcam_depth_ros import networks
from radcam_depth_ros.files import FileError
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.networks import Depths
from radcam_depth_ros.networks.weights_io import archive, torchscript
from radcam_depth_ros.networks.weights_io.archive import ArchiveError, Card
from radcam_depth_ros.networks.weights_io.card import card_text

ARCHITECTURE = {"channel_attention": False, "position_attention": False, "bidirectional": False}


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("weights") / "baff.safetensors"
    network = networks.create("baff", ARCHITECTURE)
    archive.save(network, Card.of(network, "baff", "nothing", {"mae_80_m": 1.5}), path)
    return path


@pytest.fixture
def copied(weights: Path, tmp_path: Path) -> Path:
    """The same as earlier versions wrote them: with the card beside them alone, and the hash of the whole file."""
    path = tmp_path / weights.name
    save_file(load_file(weights), path)
    path.with_suffix(".yaml").write_bytes(weights.with_suffix(".yaml").read_bytes())
    rewrite_card(path, sha256=hashlib.sha256(path.read_bytes()).hexdigest())
    return path


def inputs() -> tuple[torch.Tensor, ...]:
    radar = torch.tensor([[[40.0, 30, 20, 5, 1, 0]]])
    return torch.rand(1, 3, 64, 96), radar, torch.ones(1, 1, dtype=torch.bool), torch.full((1, 4), float("nan"))


def run(module: torch.nn.Module, given: tuple[torch.Tensor, ...]) -> Depths:
    with torch.inference_mode():
        return Depths(*module(*given))


def test_weights_come_back_in_half_precision(weights: Path) -> None:
    loaded = archive.load(weights)
    assert loaded.card.network == "baff"
    assert loaded.card.architecture["bidirectional"] is False
    assert loaded.card.metrics == {"mae_80_m": 1.5}
    stored = load_file(weights)
    assert {stored[name].dtype for name, _ in loaded.network.named_parameters()} == {torch.float16}
    torch.manual_seed(0)
    original = networks.create("baff", ARCHITECTURE).eval()
    given = inputs()
    torch.testing.assert_close(run(loaded.network, given).dense, run(original, given).dense, rtol=2e-2, atol=2e-2)


def test_an_export_is_self_contained_and_equal(weights: Path, tmp_path: Path) -> None:
    loaded = archive.load(weights)
    torchscript.export(loaded, tmp_path / "baff.pt")
    exported = archive.load(tmp_path / "baff.pt")
    assert exported.card == loaded.card
    given = inputs()
    for a, b in zip(run(loaded.network, given), run(exported.network, given), strict=True):
        torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-4, equal_nan=True)
    assert [path.name for path in tmp_path.iterdir()] == ["baff.pt"]


def test_what_ships_loads_and_names_its_training() -> None:
    for name in networks.names():
        if archive.shipped(name).exists():
            loaded = archive.load(name)
            assert loaded.card.network == name
            assert loaded.card.training_data
            assert archive.shipped(name).stat().st_size < 40e6


def test_exports_and_foreign_weights_are_loaded_where_that_is_allowed(weights: Path, tmp_path: Path) -> None:
    exported = tmp_path / "baff.pt"
    torchscript.export(archive.load(weights), exported)
    with pytest.raises(ArchiveError, match=r"baff\.pt is no \.safetensors file.*allow_exported"):
        archive.load(exported, allow_exported=False)
    assert archive.load(weights, allow_exported=False).card.network == "baff"
    for path in (weights, exported):
        sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
        assert archive.load(path, trusted=["0" * 64, sha256.upper()]).card.network == "baff"
        with pytest.raises(ArchiveError, match=f"not among trusted_models: its SHA-256 is {sha256}"):
            archive.load(path, trusted=["0" * 64])


def test_missing_files(tmp_path: Path) -> None:
    with pytest.raises(ArchiveError, match="no weight file at"):
        archive.load(tmp_path / "none.safetensors")


def test_a_missing_card(copied: Path) -> None:
    copied.with_suffix(".yaml").unlink()
    with pytest.raises(ArchiveError, match=r"have no card inside; expected baff\.yaml"):
        archive.load(copied)


def test_the_card_travels_inside_and_the_one_beside_is_for_people(weights: Path, tmp_path: Path) -> None:
    alone = tmp_path / "alone.safetensors"
    alone.write_bytes(weights.read_bytes())
    card = archive.load(alone).card
    assert card == archive.load(weights).card
    assert yaml.safe_load(weights.with_suffix(".yaml").read_text()) == yaml.safe_load(card_text(card))
    alone.with_suffix(".yaml").write_text("- 1")
    assert archive.load(alone).card == card


def test_weights_of_earlier_versions_are_loaded_with_the_card_beside_them(weights: Path, copied: Path) -> None:
    new, old = archive.load(weights), archive.load(copied)
    assert old.card.architecture == new.card.architecture
    for name, value in new.network.state_dict().items():
        assert torch.equal(old.network.state_dict()[name], value)


@pytest.mark.parametrize("is_old", [False, True])
def test_corrupt_weights(is_old: bool, weights: Path, copied: Path) -> None:
    data = bytearray((copied if is_old else weights).read_bytes())
    data[-100] ^= 255
    copied.write_bytes(data)
    with pytest.raises(ArchiveError, match="sha256 differs"):
        archive.load(copied)


def rewrite_card(path: Path, **changes: object) -> None:
    card = yaml.safe_load(path.with_suffix(".yaml").read_text())
    card.update(changes)
    path.with_suffix(".yaml").write_text(yaml.safe_dump(card))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"card_format": 99}, "card format 99"),
        ({"focal_length_px": 100.0}, "contradicts itself: focal_length_px"),
        ({"network": "other"}, "unknown network 'other'"),
        ({"architecture": {"bidirectional": True}}, "does not fit its architecture: it has, besides what"),
        ({"architecture": {**ARCHITECTURE, "embedding_dims": 16}}, "should be"),
        ({"surprise": 1}, "unknown key surprise"),
    ],
)
def test_cards_that_do_not_fit(copied: Path, changes: dict[str, object], message: str) -> None:
    rewrite_card(copied, **changes)
    with pytest.raises(RadcamDepthError, match=message):
        archive.load(copied)


def test_a_card_that_is_no_card(copied: Path) -> None:
    copied.with_suffix(".yaml").write_text("- 1")
    with pytest.raises(ArchiveError, match="holds no card"):
        archive.load(copied)


@pytest.mark.parametrize("value", ["2001-99-99", "9" * 5000, "0x" + "f" * 5000, "!!bool 3", "!!binary x"])
def test_a_card_with_a_value_that_is_not_what_its_form_says(value: str, copied: Path) -> None:
    copied.with_suffix(".yaml").write_text(f"network: {value}")
    with pytest.raises(ArchiveError, match="holds no card"):
        archive.load(copied)


def test_weights_that_are_not_finite(copied: Path) -> None:
    tensors = load_file(copied)
    name = next(key for key, value in tensors.items() if value.is_floating_point())
    tensors[name].view(-1)[0] = float("nan")
    save_file(tensors, copied)
    rewrite_card(copied, sha256=hashlib.sha256(copied.read_bytes()).hexdigest())
    with pytest.raises(ArchiveError, match="not finite"):
        archive.load(copied)


def test_a_card_that_is_too_long_is_not_read(copied: Path) -> None:
    copied.with_suffix(".yaml").write_text("a: " + "x" * 70_000)
    with pytest.raises(ArchiveError, match=r"at most 65536 bytes in .*baff\.yaml, got 70003"):
        archive.load(copied)


def test_a_card_of_lists_within_lists_is_refused_at_once(copied: Path) -> None:
    copied.with_suffix(".yaml").write_text("a: " + "[" * 30_000 + "]" * 30_000)
    with pytest.raises(ArchiveError, match="more than 100 lists or mappings"):
        archive.load(copied)


def test_a_card_of_aliases_and_one_of_a_billion_channels_take_no_memory(copied: Path) -> None:
    rewrite_card(copied, architecture={**ARCHITECTURE, "channels": [2**20] * 4})
    with pytest.raises(RadcamDepthError, match="should be"):
        archive.load(copied)
    laughs = ["a0: &a0 [1, 1]", *(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 30))]
    copied.with_suffix(".yaml").write_text("\n".join(laughs))
    with pytest.raises(ArchiveError, match="holds no card"):
        archive.load(copied)


def test_loading_and_running_weights_writes_nothing(
    weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    exported = tmp_path / "baff.pt"
    torchscript.export(archive.load(weights), exported)
    monkeypatch.chdir(tmp_path)
    before = {path: path.stat().st_mtime_ns for folder in (weights.parent, tmp_path) for path in folder.iterdir()}
    for source in (weights, exported):
        run(archive.load(source).network, inputs())
    for source in ("../new.safetensors", tmp_path / "new.pt", tmp_path, "/dev/null"):
        with pytest.raises(ArchiveError, match="no weight file at"):
            archive.load(source)
    assert before == {
        path: path.stat().st_mtime_ns for folder in (weights.parent, tmp_path) for path in folder.iterdir()
    }


def test_nothing_half_written_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(Path, "write_bytes", fail)
    network = networks.create("baff", ARCHITECTURE)
    with pytest.raises(FileError, match="disk full"):
        archive.save(network, Card.of(network, "baff", "nothing"), tmp_path / "baff.safetensors")
    assert list(tmp_path.iterdir()) == []


def test_statistics_beyond_half_precision_come_back(tmp_path: Path) -> None:
    network = networks.create("baff", ARCHITECTURE)
    with torch.no_grad():
        network.get_buffer("fusion.bidirectional.top_down.0.conv.1.running_var").fill_(1e6)
    archive.save(network, Card.of(network, "baff", "nothing"), tmp_path / "baff.safetensors")
    loaded = archive.load(tmp_path / "baff.safetensors").network
    assert float(loaded.get_buffer("fusion.bidirectional.top_down.0.conv.1.running_var")[0]) == 1e6


def test_weights_beyond_half_precision_are_not_written(tmp_path: Path) -> None:
    network = networks.create("baff", ARCHITECTURE)
    with torch.no_grad():
        network.get_parameter("fusion.head.1.bias").fill_(1e6)
    with pytest.raises(ArchiveError, match=r"fusion.head.1.bias is not finite in half precision"):
        archive.save(network, Card.of(network, "baff", "nothing"), tmp_path / "baff.safetensors")
    assert list(tmp_path.iterdir()) == []


def test_a_frozen_network_goes_with_its_last_user_and_its_errors_can_be_told(weights: Path) -> None:
    frozen = torchscript.freeze(archive.load(weights).network)
    gc.collect()
    image, *others = inputs()
    for _ in range(3):
        run(frozen, (image, *others))
    with pytest.raises(RuntimeError):
        run(frozen, (image[:, :2], *others))
    graph = frozen.inlined_graph
    constants = [
        node.t("value").untyped_storage()
        for node in graph.findAllNodes("prim::Constant")
        if node.hasAttribute("value") and node.kindOf("value") == "t"
    ]
    assert sum(storage.nbytes() for storage in constants) > 1e6
    held = [StorageWeakRef(storage) for storage in constants]
    del frozen, graph, constants
    gc.collect()
    assert all(storage.expired() for storage in held)
