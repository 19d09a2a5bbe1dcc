from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest
import torch
import yaml
from safetensors.torch import load_file, save_file

from radcam_depth_ros import configuration, networks
from radcam_depth_ros.networks import ArchitectureError, registry
from radcam_depth_ros.networks.migration import ArchitectureWarning, migrated
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.networks.weights_io.archive import Card

OLD_PAPER = {
    "association": "regions",
    "fusion": "paper",
    "threshold": 0.5,
    "caution": 0.7,
    "region_width_px": 64,
    "embedding_dims": 32,
    "considered": 8,
    "radar_map_size": [4, 5],
    "channels": [32, 64, 128, 192],
    "blocks": [1, 2, 2, 2],
    "detail": 2,
    "bidirectional": False,
    "channel_attention": True,
    "position_attention": True,
    "position_pool": [16, 8, 4, 1],
    "ground_prior": True,
    "road": True,
    "instance_norm": 2,
    "context": "none",
    "min_depth_m": 1.0,
    "max_depth_m": 100.0,
    "focal_length_px": 630.0,
}


def save(folder: Path, name: str, architecture: dict[str, object], old_name: str, old: dict[str, object]) -> Path:
    """Weights with a card as an earlier version wrote it."""
    torch.manual_seed(0)
    network = networks.create(name, architecture)
    path = folder / f"{name}.safetensors"
    card = archive.save(network, Card.of(network, name, "nothing"), path)
    save_file(load_file(path), path)
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    path.with_suffix(".yaml").write_text(
        yaml.safe_dump(configuration.as_mapping(replace(card, network=old_name, architecture=old, sha256=sha256)))
    )
    return path


def test_a_card_of_the_papers_form_is_read_as_its_network(tmp_path: Path) -> None:
    own = {"region_width_px": 64, "radar_map_size": [4, 5], "bidirectional": False}
    path = save(tmp_path, "baff_paper", own, "baff", OLD_PAPER)
    with pytest.warns(ArchitectureWarning, match="baff with fusion: paper is the network baff_paper now"):
        loaded = archive.load(path)
    assert loaded.card.network == "baff_paper"
    assert loaded.network.config == registry.create_config("baff_paper", own)


def test_a_card_with_old_keys_is_read(tmp_path: Path) -> None:
    old = {"fusion": "quarter", "considered": 5}
    without = {
        "returns_per_cell": 5,
        "geometry_mix": False,
        "full_size": False,
        "hint": False,
        "context": "none",
        "familiar": 0.0,
    }
    path = save(tmp_path, "baseline", without, "baseline", old)
    with pytest.warns(ArchitectureWarning, match="considered is called returns_per_cell now"):
        loaded = archive.load(path)
    assert loaded.network.config == registry.create_config("baseline", without)


def test_an_old_key_of_a_recipe_is_read() -> None:
    with pytest.warns(ArchitectureWarning, match="considered is called returns_per_cell now"):
        assert networks.create("baff", {"considered": 3}).config.returns_per_cell == 3


def test_the_papers_form_is_named_as_the_network_that_it_is() -> None:
    with (
        pytest.warns(ArchitectureWarning, match="is the network baff_paper now"),
        pytest.raises(ArchitectureError, match="name baff_paper instead"),
    ):
        networks.create("baff", OLD_PAPER)


def test_what_is_of_today_is_left_as_it_is() -> None:
    values = {"fusion": "conf", "considered": 1}
    assert migrated("structured", values) == ("structured", values)
    assert migrated("baff", {"detail": 2}) == ("baff", {"detail": 2})
