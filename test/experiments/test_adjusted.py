from __future__ import annotations

from pathlib import Path

import pytest
import torch

from experiments.adjusted import adjusted
from radcam_depth_ros import networks
from radcam_depth_ros.networks.weights_io import archive


@pytest.mark.parametrize("name", ["baff", "lircdepth"])
def test_values_change_and_weights_do_not(name: str, tmp_path: Path) -> None:
    network = networks.create(name)
    path = tmp_path / f"{name}.safetensors"
    archive.save(network, archive.Card.of(network, name, "nothing"), path)
    loaded = archive.load(path)
    assert loaded.card.architecture["caution"] > 0
    del loaded.card.architecture["caution"]  # as in cards that are older than it
    found = adjusted(loaded, caution=0.0, threshold=0.3, unheard_of=1.0)
    assert (found.config.caution, found.config.threshold) == (0.0, 0.3)
    assert not found.training
    wanted = loaded.network.state_dict()
    assert found.state_dict().keys() == wanted.keys()
    assert all(torch.equal(value, wanted[key]) for key, value in found.state_dict().items())
