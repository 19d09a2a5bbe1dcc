"""Parameters that change while the node is active, and images without radar."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from radcam_depth_ros.messages import decode_image

IMAGE = "sensor_msgs/msg/Image"


@pytest.fixture(scope="module")
def bench(start_for_module: Callable[..., Any]) -> Any:
    return start_for_module()


def test_outputs_change_from_one_image_to_the_next(bench: Any) -> None:
    previews: list[Any] = []
    clouds: list[Any] = []
    bench.subscribe("depth/preview", IMAGE, previews.append)
    bench.subscribe("depth/points", "sensor_msgs/msg/PointCloud2", clouds.append)
    bench.connect()
    assert bench.await_depth().encoding == "32FC1"
    bench.send_until(lambda: clouds and previews, what="preview and points")
    session, estimator = bench.node._session, bench.node._estimator
    for name, value in {
        "depth_encoding": "16UC1",
        "preview_colormap": "grey",
        "points_stride": 4,
        "output_size": "network",
    }.items():
        assert bench.set_parameter(name, value) == ""
    clouds.clear()
    previews.clear()
    bench.send_until(lambda: bench.depth[-1].encoding == "16UC1", what="16UC1")
    bench.send_until(lambda: clouds and clouds[-1].width == 96 * 64 // 16, what="a sixteenth of the points")
    bench.send_until(lambda: previews and not np.ptp(decode_image(previews[-1]).image, axis=2).any(), what="grey")
    assert (bench.node._session, bench.node._estimator) == (session, estimator)
    assert estimator.config.output_size == "network"
    bench.until(lambda: any("set: depth_encoding 16UC1" in log for log in bench.logs), what="a line in the log")

    assert "preview_near_m < preview_far_m" in bench.set_parameter("preview_near_m", 500.0)
    assert "deactivate it first" in bench.set_parameter("network", "cafnet")
    assert "deactivate it first" in bench.set_parameter("image_topic", "other")
    assert bench.set_parameter("points_far_m", 2.5) == ""  # the depth is 3 m
    bench.send_until(lambda: clouds[-1].width == 0, what="no points")
    assert bench.set_parameter("points_organized", True) == ""
    bench.send_until(lambda: (clouds[-1].height, clouds[-1].width) == (16, 24), what="rows and columns")
    assert bench.set_parameter("points_far_m", 1000.0) == ""
    bench.send_until(lambda: clouds[-1].is_dense, what="a point of each pixel")
    assert bench.set_parameter("points_min_confidence", 0.6) == ""  # the confidence is 0.5
    bench.send_until(lambda: not clouds[-1].is_dense, what="no doubtful points")
    assert np.frombuffer(bench.depth[-1].data, np.uint16).all()
    assert bench.set_parameter("min_confidence", 0.6) == ""
    bench.send_until(lambda: not np.frombuffer(bench.depth[-1].data, np.uint16).any(), what="no doubtful depth")
    assert "out of range Min: 0.0, Max: 1.0" in bench.set_parameter("min_confidence", 1.5)
    assert bench.set_parameter("min_confidence", 0.0) == ""
    # What was set holds when the node is activated again.
    assert bench.change_state("deactivate")
    assert bench.change_state("activate")
    assert bench.await_depth().encoding == "16UC1"
    assert bench.node._estimator is estimator


def test_compressed_depth_that_cannot_be_written_is_named_and_all_else_comes(
    bench: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    compressed: list[Any] = []
    bench.subscribe("depth/image_rect/compressedDepth", "sensor_msgs/msg/CompressedImage", compressed.append)
    bench.connect()
    bench.send_until(lambda: compressed, what="compressed depth")
    monkeypatch.setattr("cv2.haveImageWriter", lambda _: False)
    bench.send_until(lambda: bench.status("output", "compressedDepth has subscribers, who will hear nothing: expected"))
    bench.await_depth()
    monkeypatch.undo()
    compressed.clear()
    bench.send_until(lambda: compressed, what="compressed depth again")


def test_what_becomes_of_an_image_without_radar_can_change_while_the_node_is_active(bench: Any) -> None:
    bench.connect()
    for name, value in {"depth_encoding": "32FC1", "without_radar": "suppress", "max_time_offset_s": 0.01}.items():
        assert bench.set_parameter(name, value) == ""

    def without_radar() -> None:
        bench.send("camera_info", bench.camera_info())
        bench.send("image", bench.image())

    bench.await_depth()
    bench.send_until(lambda: bench.status("pairing", "so the image gets no depth"), without_radar, what="its line")
    values = {value.key: value.value for value in bench.diagnostics[-1]["output"].values}
    assert int(values["dropped: without radar"]) > 0
    before = len(bench.depth)
    assert bench.set_parameter("without_radar", "hold") == ""
    assert bench.set_parameter("max_hold_s", 10.0) == ""
    depth = bench.await_depth(without_radar)
    assert len(bench.depth) > before
    assert np.frombuffer(depth.data, np.float32)[0] == 3.0  # of two returns, which are held
    assert bench.set_parameter("without_radar", "camera_only") == ""
    bench.send_until(lambda: np.frombuffer(bench.depth[-1].data, np.float32)[0] == 1.0, without_radar, what="camera")
