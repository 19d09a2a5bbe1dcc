from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch.nn import functional

from radcam_depth_ros import networks
from radcam_depth_ros.networks.baff.detail import BILINEAR, Detail, enlarged
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.training.initial import load_initial


def make_inputs(batch: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Images of 64 x 96 pixels with five returns each on a road that is told."""
    radar = torch.rand(batch, 5, 6) * torch.tensor([96.0, 64.0, 40.0, 5.0, 1.0, 0.1]) + torch.tensor(
        [0, 0, 2.0, 0, 0, 0]
    )
    ground = torch.tensor([[0.0, 1 / 630 / 1.5, -0.02, 1.0]]).expand(batch, -1)
    return torch.rand(batch, 3, 64, 96), radar, torch.ones(batch, 5, dtype=torch.bool), ground


def test_before_training_a_depth_is_enlarged_bilinearly() -> None:
    plane = torch.rand(2, 1, 6, 10)
    logits = torch.log(torch.tensor(BILINEAR)).repeat(4).reshape(1, -1, 1, 1).expand(2, -1, 6, 10)
    expected = functional.interpolate(plane, scale_factor=2.0, mode="bilinear")
    torch.testing.assert_close(enlarged(plane, logits), expected, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("part", "neighbour", "row", "column", "source"),
    [
        (0, 0, 2, 4, (1, 2)),  # the upper left part takes the pixel itself
        (0, 1, 2, 4, (0, 2)),  # the one above
        (0, 2, 2, 4, (1, 1)),  # the one to the left
        (0, 3, 2, 4, (0, 1)),
        (1, 2, 2, 5, (1, 3)),  # the upper right part: the one to the right
        (2, 1, 3, 4, (2, 2)),  # the lower left part: the one below
        (3, 3, 3, 5, (2, 3)),
    ],
)
def test_each_part_of_a_pixel_chooses_among_its_neighbours(
    part: int, neighbour: int, row: int, column: int, source: tuple[int, int]
) -> None:
    """So that an edge between two depths stays one, wherever within a pixel it runs."""
    plane = torch.rand(1, 1, 3, 5)
    logits = torch.zeros(1, 16, 3, 5)
    logits[:, 4 * part + neighbour] = 50.0
    assert enlarged(plane, logits)[0, 0, row, column] == pytest.approx(float(plane[0, 0, source[0], source[1]]))


def test_before_training_nothing_is_corrected() -> None:
    correction, logits = Detail(8, 11).eval()(torch.rand(1, 3, 32, 64), torch.rand(1, 8, 8, 16))
    assert correction.shape == (1, 11, 16, 32)
    assert not correction.any()
    torch.testing.assert_close(logits[0, :4, 3, 5].exp(), torch.tensor(BILINEAR))


@pytest.mark.parametrize("batch", [1, 2])
def test_parts_of_a_picture_give_what_the_whole_gives(batch: int) -> None:
    torch.manual_seed(0)
    detail = Detail(8, 11).eval()
    for parameter in detail.parameters():
        torch.nn.init.normal_(parameter, std=0.2)
    image, features = torch.rand(batch, 3, 96, 64), torch.rand(batch, 8, 24, 16)
    in_parts = detail(image, features)
    for module in detail.modules():
        if not isinstance(module, torch.nn.BatchNorm2d):
            module.training = True  # as a whole, with the same statistics
    for part, whole in zip(in_parts, detail(image, features), strict=True):
        torch.testing.assert_close(part, whole, rtol=1e-5, atol=1e-6)


def test_weights_without_detail_and_context_are_trained_on_from_the_depth_that_they_have(tmp_path: Path) -> None:
    torch.manual_seed(0)
    former = {"full_size": False, "hint": False, "context": "none"}
    earlier, path = networks.create("baff", former).eval(), tmp_path / "earlier.safetensors"
    archive.save(earlier, archive.Card.of(earlier, "baff", "nothing"), path)
    network = networks.create("baff").eval()
    load_initial(network, "baff", path)
    inputs = make_inputs(1)
    with torch.inference_mode():
        before, after = earlier(*inputs), network(*inputs)
    torch.testing.assert_close(after.dense, before.dense, rtol=1e-4, atol=1e-3)
    torch.testing.assert_close(after.confidence, before.confidence, rtol=1e-4, atol=1e-4)


def test_groups_of_classes_are_told_in_training_alone() -> None:
    network = networks.create("baff")
    outputs = network.train_outputs(*make_inputs(2))
    assert outputs.group_logits.shape == (2, 3, 16, 24)
    network.hint.requires_grad_(False)
    assert network.train_outputs(*make_inputs(2)).group_logits is None
