from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from experiments import systems
from radcam_depth_ros import networks
from radcam_depth_ros.benchmarking.subject import Size
from radcam_depth_ros.networks.weights_io import archive

SMALL = {"backbone": "resnet18", "joined_channels": 16, "radar_channels": [8, 8, 8, 8, 8]}


@pytest.mark.exhaustive
def test_networks_are_held_side_by_side(
    tmp_path: Path,
    write_drive: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    torch.manual_seed(0)
    network = networks.create("structured", SMALL)
    weights = tmp_path / "structured.safetensors"
    archive.save(network, archive.Card.of(network, "structured", "nothing"), weights)
    bag = write_drive(tmp_path / "1000000.mcap", frames=2)
    words = ["systems", "--drives", f"some={bag}", "--drives", f"others={bag}", "--rounds", "2"]
    words += ["--network", f"structured={weights}", "--network", "baff", "--json", str(tmp_path / "figures.json")]
    monkeypatch.setattr(sys, "argv", words)
    monkeypatch.setattr(systems, "PAPERS_SIZE", Size(64, 96, 4))
    systems.main()
    rows = json.loads((tmp_path / "figures.json").read_text(encoding="utf-8"))["networks"]
    assert list(rows) == ["structured", "baff"]
    assert rows["baff"]["time"] == 1.0
    assert rows["structured"]["parameters_m"] == pytest.approx(
        sum(value.numel() for value in network.parameters()) / 1e6
    )
    for row in rows.values():
        assert row["gflop"] > 0
        assert row["some"]["frames"] == 2
        assert row["some"] == row["others"]
        assert set(row["some"]["dense"]) == set(row["some"]["camera_only"]) == {"50", "70", "80"}
    assert rows["baff"]["some"]["ground_nearest"] == rows["structured"]["some"]["ground_nearest"]
    printed = capsys.readouterr().out.splitlines()
    assert sum(line.startswith("| `structured`") for line in printed) == 5
    assert sum(line.startswith("| `structured`, without radar") for line in printed) == 2
    assert {line.count("|") for line in printed if line.startswith("| `baff`, without")} == {14}
