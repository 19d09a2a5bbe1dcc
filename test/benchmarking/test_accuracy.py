from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from radcam_depth_ros.benchmarking.accuracy import difference_over_drive
from radcam_depth_ros.benchmarking.comparison import Against, compare
from radcam_depth_ros.benchmarking.rotation import Schedule
from radcam_depth_ros.benchmarking.subject import BenchmarkError, Running, Subject
from radcam_depth_ros.drive import Sample
from radcam_depth_ros.estimator import Estimator
from radcam_depth_ros.frame import CameraModel, Frame, RadarReturns

CAMERA = CameraModel(64, 32, 630.0, 630.0, 31.5, 15.5)


def sample(stamp_ns: int = 0) -> Sample:
    frame = Frame(stamp_ns, "camera", np.zeros((32, 64, 3), np.uint8), CAMERA, RadarReturns.empty())
    return Sample(frame, ("/radar",), np.full((32, 64), 20.0, np.float32), "exact", None)


def gives(depth_m: float) -> Estimator:
    """An estimator of one depth."""
    dense = np.full((32, 64), depth_m, np.float32)
    return cast(Estimator, SimpleNamespace(estimate=lambda frame: SimpleNamespace(dense=dense)))


def test_errors_and_difference_are_averaged_over_frames() -> None:
    figures = difference_over_drive([sample(0), sample(1)], gives(21.0), gives(22.0))
    assert figures.frames == 2
    assert figures.depth_difference == pytest.approx(1 / 22)
    assert (figures.mae_m, figures.other_mae_m) == (pytest.approx(1.0), pytest.approx(2.0))
    assert figures.as_json()["mae_change"] == 0.5


def test_no_ground_truth_is_no_error() -> None:
    unknown = dataclasses.replace(sample(), depth_m=np.full((32, 64), np.nan, np.float32))
    values = difference_over_drive([unknown], gives(21.0), gives(22.0)).as_json()
    assert values["mae_m"] is values["other_mae_m"] is values["mae_change"] is None


def test_no_frames_are_refused() -> None:
    with pytest.raises(BenchmarkError, match="at least one image"):
        difference_over_drive([], gives(1.0), gives(1.0))


def test_precisions_of_one_network_differ_little_over_frames(tiny: str) -> None:
    against = Against("precision=float32", Subject(tiny, precision="float32"), samples=[sample()])
    figures = compare(Running.start(Subject(tiny, precision="bfloat16")), (), against, Schedule(), lambda *_: None)
    assert figures.drive is not None
    assert figures.drive.frames == 1
    assert figures.drive.mae_change < 0.05


@pytest.mark.parametrize("difference", [{"architecture": {"width": 16}}, {"mode": "eager"}])
def test_a_bag_is_for_two_precisions_of_the_same_weights(tiny: str, difference: dict[str, Any]) -> None:
    against = Against("x", Subject(tiny, **difference), samples=[sample()])
    with pytest.raises(BenchmarkError, match="two precisions of the same weights"):
        compare(Running.start(Subject(tiny)), (), against, Schedule(), lambda *_: None)
