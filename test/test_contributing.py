"""The steps of CONTRIBUTING.md, done in a copy of the checkout: a new network and a new topic."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

NETWORK = '''"""`dummy`: the same depth everywhere."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from radcam_depth_ros.networks.config import NetworkConfig
from radcam_depth_ros.networks.interface import Depths, SinglePass
from radcam_depth_ros.networks.registry import register


@dataclass(frozen=True)
class DummyConfig(NetworkConfig):
    """Architecture of `dummy`."""


class DummyOutputs(NamedTuple):
    """The depths."""

    depths: Depths


@register("dummy")
class Dummy(SinglePass):
    """One convolution; see `interface` for shapes."""

    about = "one convolution"
    config_type = DummyConfig

    def __init__(self, config: DummyConfig) -> None:
        super().__init__(config)
        self.conv = nn.Conv2d(3, 2, 1)

    def outputs(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> DummyOutputs:
        """Both maps of the convolution."""
        dense, confidence = self.conv(image).float().sigmoid().split(1, dim=1)
        return DummyOutputs(Depths(1.0 + 98.0 * dense, torch.full_like(dense, float("nan")), confidence))
'''
LOSSES = '''"""Losses of `dummy`: an L1."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from radcam_depth_ros.networks.dummy import DummyOutputs
from radcam_depth_ros.training.data.batches import Batch
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.losses.masked import masked_mean


@dataclass(frozen=True)
class LossConfig:
    """Weight of the L1."""

    depth: float


def total_loss(
    outputs: DummyOutputs, batch: Batch, max_depth_m: float, config: LossConfig, ranks: Ranks
) -> tuple[Tensor, dict[str, Tensor]]:
    """The total and its parts."""
    truth_m = batch.depth_accumulated_m
    known = (truth_m > 0) & (truth_m <= max_depth_m)
    depth = masked_mean((outputs.depths.dense - truth_m.where(known, outputs.depths.dense)).abs(), known, ranks)
    return config.depth * depth, {"depth": depth.detach()}
'''
NETWORK_TEST = """from radcam_depth_ros import networks


def test_it_is_registered() -> None:
    assert "dummy" in networks.names()
"""
OUTPUT = '''        Output("dummy", "depth/dummy", _IMAGE, _dummy, "The confidence again."),
    )
}
"""Every output topic, by name."""'''
OUTPUT_TEST = """from radcam_depth_ros.encoder import OUTPUTS


def test_its_name() -> None:
    assert OUTPUTS["dummy"].topic == "depth/dummy"
"""
ENCODER = """def _dummy(given: EncoderInput) -> Any:
    return encode_confidence(given.factory, given.result.confidence, *given.stamp)


_IMAGE, _CAMERA_INFO ="""


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The files of the checkout; weights, which are large and stay as they are, as links."""
    target = tmp_path / "copy"
    for folder in ("radcam_depth_ros", "test", "scripts", "config", "launch", "docs"):
        left_out = shutil.ignore_patterns("__pycache__", "weights", "images")
        shutil.copytree(ROOT / folder, target / folder, ignore=left_out)
    (target / "radcam_depth_ros" / "weights").symlink_to(ROOT / "radcam_depth_ros" / "weights")
    for file in ("README.md", "CONTRIBUTING.md", "pyproject.toml", "CHANGELOG.rst", "CITATION.cff", "package.xml"):
        shutil.copy(ROOT / file, target / file)
    return target


def insert(file: Path, before: str, new: str) -> None:
    """Puts text in the place of text that the file has exactly once."""
    text = file.read_text(encoding="utf-8")
    assert text.count(before) == 1, f"{before!r} in {file}"
    file.write_text(text.replace(before, new), encoding="utf-8")


def run(copy: Path, *command: str) -> str:
    """Output of Python in the copy; its modules come before those that are installed."""
    done = subprocess.run(
        [sys.executable, *command],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout


def run_tests(copy: Path, *arguments: str) -> str:
    return run(copy, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *arguments)


@pytest.mark.exhaustive
@pytest.mark.timeout(600)
def test_a_network_takes_five_files(copy: Path) -> None:
    package = copy / "radcam_depth_ros"
    (package / "networks" / "dummy.py").write_text(NETWORK, encoding="utf-8")
    insert(package / "networks" / "__init__.py", '    "cafnet",\n', '    "cafnet",\n    "dummy",\n')
    (package / "training" / "losses" / "dummy.py").write_text(LOSSES, encoding="utf-8")
    (package / "recipes" / "dummy.yaml").write_text("loss:\n  depth: 1.0\n", encoding="utf-8")
    (copy / "test" / "networks" / "test_dummy.py").write_text(NETWORK_TEST, encoding="utf-8")
    assert '"name": "dummy"' in run(copy, "-m", "radcam_depth_ros.cli", "networks", "--json")
    run_tests(copy, "test/networks/test_dummy.py", "test/test_architecture.py")
    out = run_tests(copy, "test/networks/test_networks.py", "test/training/test_every_network.py", "-k", "dummy")
    assert " passed" in out


@pytest.mark.exhaustive
@pytest.mark.timeout(600)
def test_a_topic_takes_three_files(copy: Path) -> None:
    encoder = copy / "radcam_depth_ros" / "encoder.py"
    insert(encoder, '    )\n}\n"""Every output topic, by name."""', OUTPUT)
    insert(encoder, "_IMAGE, _CAMERA_INFO =", ENCODER)
    (copy / "test" / "test_dummy_topic.py").write_text(OUTPUT_TEST, encoding="utf-8")
    run(copy, "scripts/generate_pages.py")
    assert "`depth/dummy`" in (copy / "README.md").read_text(encoding="utf-8")
    run_tests(
        copy, "test/test_dummy_topic.py", "test/test_pipeline.py", "test/test_replay.py", "test/test_architecture.py"
    )
    run_tests(copy, "test/node/test_node_life.py", "-k", "publish or topics or depth")
