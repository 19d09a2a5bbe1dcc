from __future__ import annotations

import numpy as np
import pytest

from radcam_depth_ros.evaluation.groups import RETURN_BINS, GroupMeans, return_bin


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
        means.add(properties, np.full(8, mae_m), {"camera_only": np.full(8, 2 * mae_m)})
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
