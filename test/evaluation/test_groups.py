from __future__ import annotations

import numpy as np
import pytest

from radcam_depth_ros.evaluation.groups import (
    RETURN_BINS,
    ComparisonMeans,
    GroupMeans,
    return_bin,
    worse_than_geometry,
)


@pytest.mark.parametrize(
    ("count", "name"),
    [
        *((0, "0"), (1, "1-10"), (10, "1-10"), (11, "11-50"), (50, "11-50"), (51, "51-200")),
        *((200, "51-200"), (201, "201-1000"), (1000, "201-1000"), (1001, ">1000"), (9000, ">1000")),
    ],
)
def test_numbers_of_returns_have_a_bin(count, name):
    assert return_bin(count) == name
    assert name in RETURN_BINS


def test_frames_are_averaged_within_their_groups():
    means = GroupMeans()
    for weather, returns, mae_m in (
        ("rain", ">1000", 1.0),
        ("dry", "0", 2.0),
        ("rain", "0", 4.0),
        ("rain", "0", np.nan),
    ):
        properties = {"weather": weather, "returns": returns}
        means.add(properties, np.full((3, 8), mae_m), {"camera_only": np.full((3, 8), 2 * mae_m)})
    groupings = {grouping.name: grouping for grouping in means.result()}
    # Returns by their number, all else as it came.
    assert [group.name for group in groupings["returns"].groups] == ["0", ">1000"]
    assert [group.name for group in groupings["weather"].groups] == ["rain", "dry"]
    rain, dry = groupings["weather"].groups
    assert (rain.dense.mae, rain.dense.frames, rain.dense.frames_without_truth) == (2.5, 2, 1)
    assert rain.baselines["camera_only"].mae == 5.0
    plain = groupings["weather"].as_json()
    assert plain["dry"]["mae"] == dry.dense.mae == 2.0
    assert plain["dry"]["baselines"]["camera_only"]["mae"] == 4.0


def test_without_frames_there_are_no_groups():
    assert GroupMeans().result() == ()


def measures_of(*mae_m):
    """(ranges, 8) with the MAE in each range."""
    return np.repeat(np.array(mae_m)[:, None], 8, axis=1)


def test_frames_are_compared_with_geometry_alone():
    means = ComparisonMeans()
    # 50, 70 and 80 m: larger by 10 % and equal; larger by 4 % and 20 %; smaller, and without ground truth.
    means.add(measures_of(1.1, 9, 2.0), measures_of(1.0, 0, 2.0))
    means.add(measures_of(1.04, 9, 2.4), measures_of(1.0, 0, 2.0))
    means.add(measures_of(0.2, 9, np.nan), measures_of(1.0, 0, np.nan))
    within = means.result()
    assert list(within) == ["50", "80"]
    assert (within["50"].frames, within["80"].frames) == (3, 2)
    assert within["50"].mae_m == pytest.approx((1.1 + 1.04 + 0.2) / 3)
    assert within["50"].geometry_mae_m == pytest.approx(1.0)
    assert (within["50"].is_worse, within["80"].is_worse) == (False, True)
    assert (within["50"].frames_share, within["80"].frames_share) == pytest.approx((1 / 3, 1 / 2))


def test_without_frames_nothing_is_worse():
    within = ComparisonMeans().result()
    assert [(entry.frames, entry.is_worse) for entry in within.values()] == [(0, False)] * 2
    assert worse_than_geometry(within, ())["80"] == {"frames_share": None, "drives": [], "frames_share_by_drive": {}}


def test_drives_that_are_worse_than_geometry_alone_are_named():
    overall, means = ComparisonMeans(), GroupMeans()
    for bag, near_m, far_m in (("a", 1.5, 1.0), ("a", 1.0, 1.0), ("b", 0.5, 3.0), ("c", 0.5, 0.5)):
        dense, geometry = measures_of(near_m, 9, far_m), measures_of(1.0, 9, 2.0)
        means.add({"bag": bag, "weather": "dry"}, dense, {"ground_nearest": geometry})
        overall.add(dense, geometry)
    groupings = means.result()
    plain = worse_than_geometry(overall.result(), groupings)
    assert plain == {
        "50": {"frames_share": 0.25, "drives": ["a"], "frames_share_by_drive": {"a": 0.5, "b": 0.0, "c": 0.0}},
        "80": {"frames_share": 0.25, "drives": ["b"], "frames_share_by_drive": {"a": 0.0, "b": 1.0, "c": 0.0}},
    }
    bags = {group.name: group for group in groupings[0].groups}
    assert [bags[name].worse_within for name in ("a", "b", "c")] == [("50",), ("80",), ()]
