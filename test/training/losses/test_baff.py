from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from radcam_depth_ros.networks import Association, Candidates, Depths, TrainOutputs
from radcam_depth_ros.training.data.batches import Batch
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.baff import (
    LossConfig,
    association_loss,
    choice_loss,
    confidence_loss,
    dense_loss,
    geometry_loss,
    group_loss,
    log_depth_loss,
    range_loss,
    thing_weight,
    total_loss,
)
from radcam_depth_ros.training.losses.registry import Criterion
from radcam_depth_ros.training.losses.road import abstention_loss, deviation_loss, road_loss
from radcam_depth_ros.training.losses.sky import sky_probability_loss
from radcam_depth_ros.training.losses.truth import without_narrow_sky

LOSS: LossConfig = Criterion.of("baff", {}).config

NAN, INF = float("nan"), float("inf")


def entropy(logit: float, label: bool) -> float:
    """Binary cross entropy of one logit."""
    return math.log1p(math.exp(-logit if label else logit))


def of_one_return(logits: torch.Tensor, depth_m: float, columns: list[int] | None = None) -> Association:
    depth = torch.full((1, 1, 1, 1), depth_m)
    return Association(logits, depth, None if columns is None else torch.tensor([[columns]]))


def test_association_counts_known_pixels_and_sky_and_weighs_positives() -> None:
    # One row of four cells: belongs to the return, does not, unknown, sky.
    truth = torch.tensor([[[[10.3, 10.5, NAN, INF]]]])
    logits = torch.tensor([[[[1.0, -2.0, 9.0, 0.5]]]])
    loss = association_loss(of_one_return(logits, 10.0), truth, replace(LOSS, positive_weight=3.0))
    expected = (3 * entropy(1.0, True) + entropy(-2.0, False) + entropy(0.5, False)) / 3
    assert float(loss) == pytest.approx(expected, rel=1e-6)


def test_association_leaves_out_columns_outside_of_the_image() -> None:
    truth = torch.full((1, 1, 1, 2), 10.0)
    logits = torch.tensor([[[[7.0, 2.0, -5.0]]]])
    loss = association_loss(of_one_return(logits, 10.0, [-1, 1, -1]), truth, replace(LOSS, positive_weight=1.0))
    assert float(loss) == pytest.approx(entropy(2.0, True), rel=1e-6)


def test_association_leaves_out_returns_without_a_depth() -> None:
    logits = torch.tensor([7.0, 2.0]).reshape(1, 2, 1, 1)
    association = Association(logits, torch.tensor([NAN, 10.0]).reshape(1, 2, 1, 1), None)
    loss = association_loss(association, torch.full((1, 1, 1, 1), 10.0), replace(LOSS, positive_weight=1.0))
    assert float(loss) == pytest.approx(entropy(2.0, True), rel=1e-6)


def test_a_sparse_truth_counts_wherever_it_lies_in_a_cell() -> None:
    truth = torch.full((1, 1, 4, 6), NAN)
    truth[0, 0, 0, 0], truth[0, 0, 0, 1] = 30.0, 10.0  # off the cell's middle: the nearest counts
    truth[0, 0, 2, 3] = INF
    logits = torch.tensor([[[[4.0, 9.0, 9.0], [9.0, -3.0, 9.0]]]])
    loss = association_loss(of_one_return(logits, 10.0), truth, replace(LOSS, positive_weight=1.0))
    assert float(loss) == pytest.approx((entropy(4.0, True) + entropy(-3.0, False)) / 2, rel=1e-6)


def test_association_takes_the_cell_centre_at_a_stride() -> None:
    truth = torch.full((1, 1, 4, 4), 50.0)
    truth[0, 0, 3, 1] = 10.0  # row 1, column 0 of the grid at stride 2
    logits = torch.zeros(1, 1, 2, 2)
    logits[0, 0, 1, 0] = 4.0
    loss = association_loss(of_one_return(logits, 10.0), truth, replace(LOSS, positive_weight=1.0))
    assert float(loss) == pytest.approx((entropy(4.0, True) + 3 * entropy(0.0, False)) / 4, rel=1e-6)


def test_association_tolerance_can_grow_with_depth() -> None:
    association = of_one_return(torch.zeros(1, 1, 1, 1), 50.0)
    truth = torch.full((1, 1, 1, 1), 51.0)
    losses = [
        float(
            association_loss(
                association,
                truth,
                replace(
                    LOSS,
                    association=5.0,
                    association_tolerance_m=0.4,
                    association_tolerance_share=share,
                    positive_weight=2.0,
                ),
            )
        )
        for share in (0.0, 0.02)
    ]
    assert losses == pytest.approx([entropy(0.0, False), 2 * entropy(0.0, True)], rel=1e-6)


def test_association_without_any_return_is_zero_and_passes_gradients() -> None:
    logits = torch.zeros(1, 0, 2, 2, requires_grad=True)
    association = Association(logits, torch.zeros(1, 0, 1, 1), torch.zeros(1, 0, 2, dtype=torch.int64))
    loss = association_loss(association, torch.ones(1, 1, 2, 2), LOSS)
    loss.backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    assert float(loss.detach()) == 0.0


def test_association_gradient_is_finite_where_truth_is_unknown() -> None:
    logits = torch.zeros(1, 1, 1, 2, requires_grad=True)
    truth = torch.tensor([[[[NAN, 10.0]]]])
    loss = association_loss(of_one_return(logits, 10.0), truth, replace(LOSS, positive_weight=2.0))
    loss.backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    assert logits.grad is not None
    assert logits.grad.flatten().tolist() == pytest.approx([0.0, -1.0])


def test_dense_loss_is_smooth_l1_and_draws_the_sky_to_the_farthest_depth() -> None:
    dense = torch.tensor([[[[10.5, 13.0, 90.0, 99.0, 5.0]]]])
    truth = torch.tensor([[[[10.0, 10.0, INF, 150.0, NAN]]]])
    in_range = (0.5 * 0.5**2 + (3.0 - 0.5)) / 2
    beyond = ((10.0 - 0.5) + (1.0 - 0.5)) / 2
    loss = dense_loss(dense, truth, 100.0, replace(LOSS, sky=0.2))
    assert float(loss) == pytest.approx(in_range + 0.2 * beyond, rel=1e-6)


def test_a_sample_that_knows_few_pixels_counts_as_much_as_one_that_knows_all() -> None:
    dense = torch.full((2, 1, 20, 50), 10.0)
    dense[1] = 13.0
    truth = torch.full((2, 1, 20, 50), 10.0)
    truth[1].fill_(NAN)
    truth[1, 0, 3, :2] = 10.0
    loss = dense_loss(dense, truth, 100.0, LOSS)
    assert float(loss) == pytest.approx(0.5 * (3.0 - 0.5))
    truth[1].fill_(NAN)  # one that knows nothing does not count at all
    truth[0] = 9.5
    assert float(dense_loss(dense, truth, 100.0, LOSS)) == pytest.approx(0.5 * 0.5**2)


def test_sky_beside_a_surface_is_unknown() -> None:
    truth = torch.full((1, 1, 9, 12), INF)
    truth[0, 0, 4, 2] = 10.0
    truth[0, 0, 0, 11] = NAN
    changed = without_narrow_sky(truth, 2)[0, 0]
    assert float(changed[4, 2]) == 10.0
    unknown = torch.isnan(changed)
    assert unknown[2:7, 0:5].sum() == 24
    assert int(unknown.sum()) == 25
    assert torch.isinf(changed[~unknown]).sum() == 9 * 12 - 26
    torch.testing.assert_close(without_narrow_sky(truth, 0), truth, equal_nan=True)


def test_log_depth_loss_counts_a_tenth_alike_near_and_far() -> None:
    dense = torch.tensor([[[[11.0, 88.0, 3.0]]]])
    truth = torch.tensor([[[[10.0, 80.0, NAN]]]])
    assert float(log_depth_loss(dense, truth, 100.0)) == pytest.approx(math.log(1.1), rel=1e-5)


def test_confidence_is_taught_whether_the_depth_is_within_ten_percent() -> None:
    dense = torch.tensor([[[[10.9, 11.1, 50.0]]]], requires_grad=True)
    truth = torch.tensor([[[[10.0, 10.0, INF]]]])
    logit = torch.tensor([[[[1.0, 2.0, 3.0]]]])
    loss = confidence_loss(logit, dense, truth, 100.0, 0.1)
    assert float(loss) == pytest.approx((entropy(1.0, True) + entropy(2.0, False)) / 2, rel=1e-6)
    assert not loss.requires_grad  # the depth is taken as it is


def choice(logits: list[float], depths_m: list[float], truth_m: float) -> float:
    """Loss of one pixel."""
    shape = (1, -1, 1, 1)
    candidates = Candidates(torch.tensor(logits).reshape(shape), torch.tensor(depths_m).reshape(shape))
    return float(choice_loss(candidates, torch.full((1, 1, 1, 1), truth_m), torch.ones(1, 1, 1, 1), 100.0, LOSS))


def test_choice_is_a_cross_entropy_when_one_candidate_is_right() -> None:
    assert choice([2.0, -1.0, 0.5], [10.0, 20.0, 50.0], 10.0) == pytest.approx(
        math.log(math.exp(2.0) + math.exp(-1.0) + math.exp(0.5)) - 2.0, rel=1e-4
    )


def test_choice_counts_a_candidate_that_is_off_by_the_tolerance_as_one_in_e() -> None:
    right, off = (choice([20.0, -20.0], [10.0, 50.0], truth) for truth in (10.0, 10.0 * math.exp(0.05)))
    assert (right, off) == (pytest.approx(0.0, abs=1e-5), pytest.approx(1.0, rel=1e-4))


def test_choice_takes_the_sky_for_the_farthest_depth_and_leaves_unknown_pixels_out() -> None:
    assert choice([20.0, -20.0], [100.0, 50.0], INF) == pytest.approx(0.0, abs=1e-5)
    assert choice([20.0, -20.0], [100.0, 50.0], NAN) == 0.0


def test_small_things_count_more_in_the_logarithm_of_depth() -> None:
    classes = torch.tensor([[[11, 0]]], dtype=torch.uint8)  # person, road
    weight = thing_weight(classes, 3.0)
    assert weight.flatten().tolist() == [3.0, 1.0]
    dense, truth = torch.tensor([[[[20.0, 10.0]]]]), torch.full((1, 1, 1, 2), 10.0)
    loss = log_depth_loss(dense, truth, 100.0, weight=weight)
    assert float(loss) == pytest.approx(3 * math.log(2) / 4, rel=1e-5)


def test_groups_are_a_cross_entropy_where_classes_are_known() -> None:
    logits = torch.zeros(1, 3, 1, 2)
    logits[0, 2, 0, 0] = 2.0
    # Each cell of 4 x 4 pixels is that of its middle: a car, of the third group, and nothing that is known.
    classes = torch.full((1, 4, 8), 255, dtype=torch.uint8)
    classes[0, 2, 2] = 13
    expected = math.log(math.exp(2.0) + 2) - 2.0
    assert float(group_loss(logits, classes)) == pytest.approx(expected, rel=1e-5)


def test_parts_that_do_not_learn_cost_nothing() -> None:
    whole = outputs()
    truth = torch.full((1, 1, 1, 2), 10.0)
    stage_1, parts_1 = total_loss(
        TrainOutputs(None, None, whole.association, None, None), batch_of(truth), 100.0, CONFIG
    )
    stage_2, parts_2 = total_loss(whole._replace(association=None), batch_of(truth), 100.0, CONFIG)
    assert float(stage_1) == pytest.approx(entropy(0, True), rel=1e-6)
    assert float(parts_1["dense"]) == 0.0
    assert float(parts_2["association"]) == 0.0
    assert float(stage_2) == pytest.approx(3.0 + 0.25 * entropy(0, False), rel=1e-6)


def batch_of(accumulated_m: torch.Tensor, single_m: torch.Tensor | None = None) -> Batch:
    """Ground truth alone; classes are unknown."""
    nothing = torch.empty(0)
    classes = torch.full((1, *accumulated_m.shape[2:]), 255, dtype=torch.uint8)
    readable = torch.ones(len(accumulated_m), dtype=torch.bool)
    return Batch(nothing, nothing, nothing, nothing, accumulated_m, single_m, classes, readable)


CONFIG = replace(LOSS, accumulated=1.0, single=1.0, log_depth=0.0, confidence=0.25, positive_weight=1.0)


def outputs() -> TrainOutputs:
    dense = torch.full((1, 1, 1, 2), 12.0)
    association = of_one_return(torch.zeros(1, 1, 1, 2), 10.0)
    return TrainOutputs(Depths(dense, dense, dense), torch.zeros(1, 1, 1, 2), association, None, None)


def test_total_counts_one_ground_truth_twice_unless_there_are_two() -> None:
    accumulated, single = torch.full((1, 1, 1, 2), 10.0), torch.full((1, 1, 1, 2), 11.0)
    config = replace(
        LOSS, association=0.5, accumulated=1.0, single=2.0, log_depth=0.0, confidence=0.25, positive_weight=1.0
    )
    association, confidence = 0.5 * entropy(0, True), 0.25 * entropy(0, False)
    one, parts = total_loss(outputs(), batch_of(accumulated), 100.0, config)
    assert float(one) == pytest.approx(association + confidence + 3 * 1.5, rel=1e-6)
    two, _ = total_loss(outputs(), batch_of(accumulated, single), 100.0, config)
    assert float(two) == pytest.approx(association + confidence + 1.5 + 2 * 0.5, rel=1e-6)
    assert float(parts["dense"]) == pytest.approx(1.5)


def test_the_road_is_judged_on_the_ground() -> None:
    truth = torch.tensor([[[[10.0, 10.0, 10.0, torch.nan, 90.0, 30.0]]]])
    road = torch.tensor([[[[11.0, 11.0, 11.0, 11.0, 95.0, 10.0]]]])
    building = 2
    classes = torch.tensor([[[0, 1, building, 0, 0, 0]]], dtype=torch.uint8)
    batch = replace(batch_of(truth), classes=classes)
    assert float(road_loss(road, truth, batch, None)) == pytest.approx(math.log(1.1), rel=1e-5)
    # Of unknown classes, what is not far from the road is taken for it.
    batch = replace(batch, classes=torch.full_like(classes, 255))
    assert float(road_loss(road, truth, batch, None)) == pytest.approx(math.log(1.1), rel=1e-5)
    assert float(road_loss(3 * road, truth, batch, None)) == 0


def test_the_road_as_told_is_the_truth_on_a_picture_that_tells_nothing() -> None:
    truth = torch.full((2, 1, 2, 2), 10.0)
    road, told = torch.full((2, 1, 2, 2), 12.0), torch.full((2, 1, 2, 2), 15.0)
    batch = replace(batch_of(truth), classes=torch.zeros(2, 2, 2, dtype=torch.uint8))
    batch = replace(batch, readable=torch.tensor([True, False]))
    expected = (math.log(1.2) + math.log(1.25)) / 2
    assert float(road_loss(road, truth, batch, told)) == pytest.approx(expected, rel=1e-5)


def test_a_roads_deviation_is_likeliest_at_its_error() -> None:
    truth = torch.full((1, 1, 2, 2), 10.0)
    road = torch.full((1, 1, 2, 2), 11.0).requires_grad_()
    classes = torch.zeros(1, 2, 2, dtype=torch.uint8)
    right = 2**0.5 * math.log(1.1)
    losses = [
        float(deviation_loss(torch.full((1, 1, 2, 2), factor * right), road, truth, classes))
        for factor in (0.5, 0.9, 1.0, 1.1, 2.0)
    ]
    assert min(losses) == losses[2]
    assert losses[0] > losses[1]
    assert losses[4] > losses[3]


def test_votes_are_taught_to_abstain() -> None:
    heard = torch.tensor([[0.9], [0.2]])
    loss = abstention_loss(heard, torch.tensor([True, False]))
    assert float(loss) == pytest.approx(-(math.log(0.9) + math.log(0.8)) / 2, rel=1e-5)


def test_errors_are_counted_as_they_are_measured() -> None:
    truth = torch.tensor([[[[10.0, 60.0, NAN, INF, 90.0]]]])
    dense = torch.tensor([[[[12.0, 70.0, 5.0, 5.0, 5.0]]]])
    assert float(range_loss(dense, truth)) == pytest.approx((2 + (2 + 10) / 2) / 2)
    beyond = torch.tensor([[[[100.0, 100.0, 5.0, 5.0, 5.0]]]])
    assert float(range_loss(beyond, truth)) == pytest.approx((40.5 + (70.2 + 20.2) / 2) / 2)


@pytest.mark.parametrize(
    "wrong", [{"sky": -1.0}, {"association_tolerance_m": 0.0}, {"positive_weight": -2.0}, {"choice": -1.0}]
)
def test_wrong_weights_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(TrainingError, match="must"):
        replace(LOSS, **wrong)


@pytest.mark.parametrize(("label", "weight"), [(2, 1), (5, 6), (6, 6), (7, 6), (254, 12)])
def test_thin_things_count_more_before_the_sky(label: int, weight: int) -> None:
    truth = torch.tensor([[[[INF, 10.0], [NAN, INF]]]]).repeat_interleave(2, 2).repeat_interleave(2, 3)
    logit = torch.tensor([[[[2.0, 2.0], [9.0, -1.0]]]])
    expected = (entropy(2.0, True) + weight * entropy(2.0, False) + entropy(-1.0, True)) / (3 + weight - 1)
    classes = torch.full((1, 4, 4), 2, dtype=torch.uint8)
    classes[:, :2, 2:] = label
    assert float(sky_probability_loss(logit, truth, classes)) == pytest.approx(expected, rel=1e-6)


def test_a_cell_that_holds_a_pixel_of_a_wire_is_the_wires() -> None:
    truth = torch.full((1, 1, 4, 4), INF)
    truth[0, 0, 1, 1] = 30.0
    classes = torch.full((1, 4, 4), 10, dtype=torch.uint8)
    classes[0, 1, 1] = 254
    expected = (12 * entropy(2.0, False) + 3 * entropy(2.0, True)) / 15
    logit = torch.full((1, 1, 2, 2), 2.0)
    assert float(sky_probability_loss(logit, truth, classes)) == pytest.approx(expected, rel=1e-6)


def test_a_scan_which_never_sees_the_sky_says_nothing_about_it() -> None:
    scan, unknown = torch.tensor([[[[10.0, NAN], [NAN, 20.0]]]]), torch.full((1, 2, 2), 255, dtype=torch.uint8)
    logit = torch.full((1, 1, 2, 2), 3.0)
    assert float(sky_probability_loss(logit, scan, unknown)) == 0
    labelled = torch.tensor([[[2, 10], [255, 2]]], dtype=torch.uint8)
    expected = (2 * entropy(3.0, False) + entropy(3.0, True)) / 3
    assert float(sky_probability_loss(logit, scan, labelled)) == pytest.approx(expected, rel=1e-6)


def test_only_a_frame_that_is_worse_than_geometry_costs() -> None:
    truth = torch.full((2, 1, 4, 4), 10.0)
    geometry = torch.full((2, 1, 2, 2), 12.0)
    dense = torch.stack([torch.full((1, 4, 4), 11.0), torch.full((1, 4, 4), 14.0)]).requires_grad_()
    loss = geometry_loss(dense, geometry, truth)
    assert float(loss.detach()) == pytest.approx(2 * (4 / 2 - 0.97) / 2)
    loss.backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    assert dense.grad is not None
    assert (dense.grad[0] == 0).all()
    assert (dense.grad[1] >= 0).all()
