from __future__ import annotations

import re

import numpy as np
import pytest

from radcam_depth_ros.drive import Sample
from radcam_depth_ros.evaluation.drive import Drive, FrameMeasures, Observation
from radcam_depth_ros.evaluation.panels import PanelKeeper
from radcam_depth_ros.frame import CameraModel, DepthResult, Frame, RadarReturns


def make_observation(index, mae_m=1.0, bag=""):
    camera = CameraModel(16, 12, 10.0, 10.0, 7.5, 5.5)
    depth = np.full((12, 16), 20.0, np.float32)
    frame = Frame(index, "camera", np.zeros((12, 16, 3), np.uint8), camera, RadarReturns.empty())
    result = DepthResult(index, "camera", camera, depth, depth, depth, 0)
    measures = FrameMeasures(np.full((3, 8), mae_m), {}, 1.0, mae_m, 0, 0.1)
    return Observation(
        Drive([], bag), index, Sample(frame, (), depth, "exact"), result, {"ground_nearest": depth}, measures
    )


@pytest.mark.parametrize("frames", [0, 1, 3, 10, 11, 57, 1000])
def test_evenly_spaced_frames_are_kept(frames):
    keeper = PanelKeeper(5, worst=1)
    for index in range(frames):
        keeper.add(make_observation(index, mae_m=float(index == frames // 2)))
        assert len(keeper._kept) <= 10
    titles = [panel.title for panel in keeper.panels()]
    even = [int(re.match(r"frame (\d+),", title)[1]) for title in titles if "worst" not in title]
    assert len(even) == min(frames, 5)
    assert even == sorted(set(even))
    assert frames < 5 or max(np.diff(even)) <= 2 * min(np.diff(even))
    assert frames == 0 or even[-1] >= (frames - 1) / 2
    assert [title for title in titles if "worst" in title] == titles[5 if frames >= 5 else frames :]
    assert frames == 0 or titles[-1].startswith(f"frame {frames // 2},")


def test_the_worst_frames_are_kept_the_worst_first():
    keeper = PanelKeeper(0, worst=3)
    for index in range(20):
        keeper.add(make_observation(index, mae_m=float(index * 7 % 20), bag="night"))
    titles = [panel.title for panel in keeper.panels()]
    assert [re.search(r"MAE (\d+)", title)[1] for title in titles] == ["19", "18", "17"]
    assert titles[0].startswith("frame 17 of night,")
    assert titles[0].endswith("the worst")
    assert titles[2].endswith("number 3 of the worst")


def test_without_ground_truth_no_frame_is_the_worst():
    keeper = PanelKeeper(2)
    keeper.add(make_observation(0, float("nan")))
    assert [panel.title for panel in keeper.panels()] == ["frame 0, stamp 0.000 s"]


@pytest.mark.parametrize("frames", [3, 4, 25, 200])
def test_the_best_the_middle_and_the_worst_frame_stand_out(frames):
    keeper, errors = PanelKeeper(), np.random.default_rng(frames).permutation(frames)
    for index, error in enumerate(errors):
        keeper.add(make_observation(index, mae_m=float(error)))
    best, middle, worst = keeper.highlights()
    shown = [float(re.search(r"MAE ([\d.]+)", highlight.panel.title)[1]) for highlight in (best, middle, worst)]
    assert (shown[0], shown[2]) == (0, frames - 1)
    assert abs(shown[1] - (frames - 1) / 2) <= max(1, 0.1 * frames)
    assert [highlight.title for highlight in (best, middle, worst)] == [
        "the best frame",
        "the middle frame",
        "the worst frame",
    ]


@pytest.mark.parametrize(("frames", "titles"), [(0, []), (1, ["worst"]), (2, ["best", "worst"])])
def test_of_few_frames_none_stands_out_twice(frames, titles):
    keeper = PanelKeeper()
    for index in range(frames):
        keeper.add(make_observation(index, mae_m=float(index)))
    assert [highlight.title for highlight in keeper.highlights()] == [f"the {title} frame" for title in titles]


def test_without_ground_truth_some_frames_stand_at_the_top():
    keeper = PanelKeeper()
    for index in range(9):
        keeper.add(make_observation(index, float("nan")))
    assert len(keeper.highlights()) == 3
