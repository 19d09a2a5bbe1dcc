from __future__ import annotations

from pathlib import Path

import pytest
import torch

from radcam_depth_ros import networks
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.initial import load_initial


def test_what_no_weight_depends_on_may_differ(small_weights: Path) -> None:
    network = networks.create("baff", {"threshold": 0.4, "caution": 0.0})
    load_initial(network, "baff", small_weights)
    again = networks.create("baff", {"threshold": 0.3, "caution": 0.9})
    load_initial(again, "baff", small_weights)
    for name, value in network.state_dict().items():
        torch.testing.assert_close(again.state_dict()[name], value)


def test_another_architecture_is_refused_naming_what_differs(small_weights: Path) -> None:
    with pytest.raises(TrainingError, match="its detail is 2, the recipe's is 4; leave detail out of the recipe"):
        load_initial(networks.create("baff", {"detail": 4, "full_size": False}), "baff", small_weights)


def test_weights_without_the_mix_can_be_trained_on_with_it(tmp_path: Path) -> None:
    earlier, path = networks.create("baff", {"geometry_mix": False}), tmp_path / "earlier.safetensors"
    archive.save(earlier, archive.Card.of(earlier, "baff", "nothing"), path)
    network = networks.create("baff")
    first = {name: value.clone() for name, value in network.state_dict().items()}
    load_initial(network, "baff", path)
    now = network.state_dict()
    assert torch.equal(now["mix.look.here.0.weight"], first["mix.look.here.0.weight"])
    assert not torch.equal(now["encoder.stem.0.0.weight"], first["encoder.stem.0.0.weight"])
