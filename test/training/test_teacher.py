"""A trained network teaches another one."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from small_training import RECIPE

from radcam_depth_ros import networks
from radcam_depth_ros.networks import Network
from radcam_depth_ros.networks.weights_io import archive, torchscript
from radcam_depth_ros.training.data.batches import Batch, collate
from radcam_depth_ros.training.data.samples import CachedDrive
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.precision import Precision
from radcam_depth_ros.training.teacher import Teacher

PRECISION = Precision(torch.device("cpu"), torch.float32)


def save(folder: Path, name: str, **architecture: object) -> Path:
    torch.manual_seed(1)
    network = networks.create(name, architecture)
    path = folder / f"{name}.safetensors"
    archive.save(network, archive.Card.of(network, name, "nothing"), path)
    return path


@pytest.fixture
def student() -> Network:
    torch.manual_seed(0)
    return networks.create("lircdepth").train()


@pytest.fixture
def batch(drive: CachedDrive) -> Batch:
    return collate([drive[0], drive[1]])


def test_the_student_learns_and_the_teacher_stays(tmp_path: Path, student: Network, batch: Batch) -> None:
    teacher = Teacher(save(tmp_path, "lircdepth"), student, RECIPE.distillation, PRECISION)
    before = {name: value.clone() for name, value in teacher._network.state_dict().items()}
    outputs = student.train_outputs(batch.image, batch.radar, batch.valid, batch.ground)
    total, parts = teacher.loss(outputs, "lircdepth", batch, Ranks())
    assert set(parts) == {"distilled_image", "distilled_radar", "distilled_decoder", "distilled_depth"}
    assert min(parts.values()) > 0
    total.backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    assert student.get_parameter("image_affinity.layers.0.weight").grad is not None
    for name, value in teacher._network.state_dict().items():
        torch.testing.assert_close(value, before[name], rtol=0, atol=0)
    assert not any(parameter.requires_grad for parameter in teacher._network.parameters())


def test_a_teacher_that_sees_otherwise_is_refused(tmp_path: Path, student: Network) -> None:
    path = save(tmp_path, "lircdepth", focal_length_px=630.0)
    with pytest.raises(TrainingError, match=r"trained at focal_length_px 630, the student is at 315; set architecture"):
        Teacher(path, student, RECIPE.distillation, PRECISION)


def test_networks_that_tell_nothing_of_themselves_cannot_teach(tmp_path: Path, student: Network, batch: Batch) -> None:
    teacher = Teacher(save(tmp_path, "baff", focal_length_px=315.0), student, RECIPE.distillation, PRECISION)
    outputs = student.train_outputs(batch.image, batch.radar, batch.valid, batch.ground)
    with pytest.raises(TrainingError, match="baff can neither teach nor learn by distillation"):
        teacher.loss(outputs, "lircdepth", batch, Ranks())


def test_an_export_cannot_teach(tmp_path: Path, student: Network) -> None:
    path = tmp_path / "baff.pt"
    torchscript.export(archive.load(save(tmp_path, "baff")), path)
    with pytest.raises(TrainingError, match=r"an export cannot teach; give the .safetensors file"):
        Teacher(path, student, RECIPE.distillation, PRECISION)
