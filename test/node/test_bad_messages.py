"""Bad messages through the live node: a line of diagnostics, one in the log, depth again with the next good one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from radcam_depth_ros.frame import CameraModel

SMALL = CameraModel(48, 32, 50.0, 50.0, 23.5, 15.5)
RADAR = "radar /radar/points"


@pytest.fixture(scope="module")
def bench(start_for_module: Callable[..., Any]) -> Any:
    """One node for all of them, as on a vehicle."""
    bench = start_for_module()
    bench.connect()
    return bench


def changed(message: Any, **fields: Any) -> Any:
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def wrong_encoding(bench: Any) -> Any:
    return {"image": changed(bench.image(), encoding="rgb7")}


def truncated_data(bench: Any) -> Any:
    image = bench.image()
    return {"image": changed(image, data=image.data[:100])}


def step_too_small(bench: Any) -> Any:
    return {"image": changed(bench.image(), step=95)}


def image_without_frame_id(bench: Any) -> Any:
    return {"image": bench.image(frame_id="")}


def image_of_another_size(bench: Any) -> Any:
    return {"image": bench.image(SMALL)}


def k_of_zeros(bench: Any) -> Any:
    return {"camera_info": changed(bench.camera_info(), k=np.zeros(9), p=np.zeros(12))}


def radar_without_x_y_z(bench: Any) -> Any:
    return {"cloud": bench.cloud(names="abc")}


def radar_step_too_small(bench: Any) -> Any:
    return {"cloud": changed(bench.cloud(), point_step=8)}


def radar_truncated(bench: Any) -> Any:
    cloud = bench.cloud()
    return {"cloud": changed(cloud, data=cloud.data[:13])}


def nan_and_infinite_points(bench: Any) -> Any:
    return {"cloud": bench.cloud([10.0, np.nan, np.inf, -np.inf])}


def points_behind_the_camera(bench: Any) -> Any:
    return {"cloud": bench.cloud([-5.0, -10.0])}


CASES = [
    (wrong_encoding, "camera", 2, ("expected an image of encoding", "got 'rgb7'")),
    (truncated_data, "camera", 2, ("expected 18432 bytes", "got 100")),
    (step_too_small, "camera", 2, ("expected a step of at least 288 bytes", "got 95")),
    (image_without_frame_id, "camera", 1, ("expected a frame_id", "camera_frame")),
    (image_of_another_size, "calibration", 2, ("expected an image of 96 x 64 pixels", "got 48 x 32")),
    (k_of_zeros, "calibration", 2, ("expected a calibrated camera with positive focal lengths", "got k=[0.0")),
    (radar_without_x_y_z, RADAR, 2, ("expected a radar cloud with fields x y z", "got a b c")),
    (radar_step_too_small, RADAR, 2, ("point_step 8", "got an end at byte 12")),
    (radar_truncated, RADAR, 2, ("expected 40 bytes", "got 13")),
    (nan_and_infinite_points, RADAR, 1, ("expected finite positions", "got 3 returns with NaN or infinity")),
    (points_behind_the_camera, "pairing", 1, ("expected radar returns in view of the camera", "got 0 of 2")),
]


@pytest.mark.parametrize(("make", "part", "level", "texts"), CASES, ids=[case[0].__name__ for case in CASES])
def test_it_is_named_and_the_next_good_message_gives_depth(
    bench: Any, make: Callable[[Any], Any], part: str, level: int, texts: tuple[str, str]
) -> None:
    bench.await_depth()
    bench.diagnostics.clear()
    status = bench.send_until(lambda: bench.status(part, texts[0]), lambda: bench.send_pair(**make(bench)), texts[0])
    for _ in range(3):
        bench.send_pair(**make(bench))
    assert texts[1] in status.message
    assert status.level == bytes([level])
    lines = bench.until(lambda: [line for line in bench.logs if texts[0] in line])
    assert len(lines) == 1
    assert texts[1] in lines[0]
    bench.await_depth()
    bench.diagnostics.clear()
    bench.send_until(lambda: bench.diagnostics and bench.diagnostics[-1][part].level == b"\x00", what="recovery")
    assert any(value.value == status.message for value in bench.diagnostics[-1][part].values)
    assert len([line for line in bench.logs if texts[0] in line]) == 1


def test_what_a_radar_is_read_from_is_told_and_what_it_lacks_is_a_warning(bench: Any) -> None:
    def told() -> dict[str, str]:
        return {value.key: value.value for value in bench.diagnostics[-1][RADAR].values}

    bench.await_depth()
    bench.diagnostics.clear()
    bench.send_until(lambda: bench.status(RADAR, "Hz on /radar/points"), what="a line on the radar")
    fields = {name: field for name, field in told().items() if name.startswith("field of ")}
    assert fields == {
        "field of the position": "x y z",
        "field of the Doppler speed": "radial_speed",
        "field of the RCS": "rcs",
    }

    def without() -> None:
        cloud = bench.cloud()
        cloud.fields[3].name, cloud.fields[4].name = "flags", "quality"
        bench.send_pair(cloud=cloud)

    text = "but expected a Doppler speed in the returns on /radar/points, found no field for it: name its field by the"
    status = bench.send_until(lambda: bench.status(RADAR, text), without, what="a warning")
    assert status.level == b"\x01"
    assert "expected an RCS in the returns" in status.message
    assert (told()["field of the Doppler speed"], told()["field of the RCS"]) == ("none", "none")
    bench.diagnostics.clear()
    bench.send_until(lambda: bench.diagnostics and bench.diagnostics[-1][RADAR].level == b"\x00", what="recovery")


def test_stamps_that_jump_back_are_named_and_depth_goes_on(bench: Any) -> None:
    bench.await_depth()
    bench.diagnostics.clear()
    bench.now_ns -= 50_000_000_000
    status = bench.send_until(lambda: bench.status("pairing", "jumped back"), what="a line about the jump")
    assert status.level == b"\x01"
    before = len(bench.depth)
    bench.send_until(lambda: len(bench.depth) > before, what="depth")
    assert len([line for line in bench.logs if "jumped back" in line]) == 1


def test_a_camera_that_changes_its_size_with_its_calibration_goes_on(bench: Any) -> None:
    bench.await_depth()
    depth = bench.await_depth(lambda: bench.send_pair(image=bench.image(SMALL), camera_info=bench.camera_info(SMALL)))
    bench.send_until(
        lambda: bench.depth[-1].width == 48,
        lambda: bench.send_pair(image=bench.image(SMALL), camera_info=bench.camera_info(SMALL)),
    )
    bench.send_until(lambda: bench.depth[-1].width == 96, what="depth at the first size")
    assert depth.height in (32, 64)
