"""A radar whose topic is a RadarScan, live: chosen by the topic's type, also where that changes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from generated_messages import require_radar_msgs
from radar_scans import SCAN, encode_scan, polar
from small_drive import CAMERA, CAMERA_FROM_RADAR, PERIOD_NS, START_NS, small_image, small_returns

from radcam_depth_ros.bags import BagReader, BagWriter, factory
from radcam_depth_ros.drive import DriveSettings
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.frame_builder import FrameBuilderConfig
from radcam_depth_ros.messages import SCAN_FIELDS, decode_depth, encode_camera_info, encode_image, encode_points
from radcam_depth_ros.node import watchdog
from radcam_depth_ros.node.topics import subscriptions
from radcam_depth_ros.node.topics.factory import build_message
from radcam_depth_ros.replay import replay

CLOUD = "sensor_msgs/msg/PointCloud2"
TOPIC = "radar/points"
RADAR = "radar /radar/points"
EXTRINSICS = tuple(float(value) for value in (*CAMERA_FROM_RADAR.translation, *CAMERA_FROM_RADAR.quaternion))
FRAMES = 3
DEPTH = ("depth/image_rect", "semi_dense/image_rect")


@pytest.fixture(autouse=True)
def _radar_msgs() -> None:
    require_radar_msgs()


def scan(bench: Any, **columns: Any) -> Any:
    """Returns ahead at 10 and 20 m, with an amplitude and a Doppler that vary."""
    changing = (np.arange(2) + bench.now_ns // 10**8 % 10).astype(np.float32)
    values = {"range": [10.0, 20.0], "doppler_velocity": -changing, "amplitude": changing, **columns}
    return encode_scan(build_message, values, bench.now_ns, "radar")


def send_scan(bench: Any, **columns: Any) -> Callable[[], None]:
    return lambda: bench.send_pair(cloud=scan(bench, **columns))


def messages(make: Any, index: int, radar_type: str) -> dict[str, Any]:
    """One frame of the small drive; the same returns, range by range, as a scan or as a cloud."""
    stamp_ns = START_NS + index * PERIOD_NS
    xyz = small_returns(index)
    columns = {**polar(xyz), "doppler_velocity": -xyz[:, 0] / 9, "amplitude": xyz[:, 0] / 5}
    encode = encode_scan if radar_type == SCAN else encode_points
    return {
        "camera_info": encode_camera_info(make, CAMERA, stamp_ns, "camera"),
        TOPIC: encode(make, {name: np.float32(columns[name]) for name in SCAN_FIELDS}, stamp_ns, "radar"),
        "image": encode_image(make, small_image(index), stamp_ns, "camera"),
    }


def replayed(folder: Path, radar_type: str, weights: Path) -> list[np.ndarray]:
    """Depth of the drive with scans or clouds, by the verb's way."""
    bag, target = folder / "drive.mcap", folder / "depth.mcap"
    types = {"image": "sensor_msgs/msg/Image", "camera_info": "sensor_msgs/msg/CameraInfo", TOPIC: radar_type}
    with BagWriter(bag) as writer:
        for index in range(FRAMES):
            for topic, message in messages(factory, index, radar_type).items():
                writer.write(f"/camera/{topic}", message, START_NS + index * PERIOD_NS, types[topic])
    estimator = Estimator(EstimatorConfig(model_file=str(weights)))
    replay(bag, target, estimator, DriveSettings(FrameBuilderConfig(camera_from_radar=EXTRINSICS)))
    with BagReader(target) as reader:
        return [decode_depth(item.message).depth_m for topic in DEPTH for item in reader.messages([f"/{topic}"])]


def played(bench: Any, radar_type: str) -> list[np.ndarray]:
    """Depth of the same drive by the live node."""
    semi_dense: list[Any] = []
    bench.subscribe(DEPTH[1], "sensor_msgs/msg/Image", semi_dense.append)
    bench.advertise(TOPIC, radar_type)
    bench.connect()

    def send(index: int) -> None:
        for topic, message in messages(build_message, index, radar_type).items():
            bench.send(topic, message)

    for index in range(FRAMES):
        bench.send_until(
            lambda index=index: min(len(semi_dense), len(bench.depth)) > index,
            lambda index=index: send(index),
            what="depth",
        )
    return [decode_depth(message).depth_m for message in (*bench.depth, *semi_dense)]


def test_a_scan_and_a_cloud_of_the_same_returns_give_the_same_depth_live_and_replayed(
    start: Callable[..., Any], small_weights: Path, tmp_path: Path
) -> None:
    found: dict[str, list[np.ndarray]] = {}
    for radar_type in (CLOUD, SCAN):
        folder = tmp_path / radar_type.rpartition("/")[2]
        folder.mkdir()
        found[f"replayed {radar_type}"] = replayed(folder, radar_type, small_weights)
        bench = start(Estimator, model_file=str(small_weights), camera_from_radar=list(EXTRINSICS), max_wait_s=0.5)
        found[f"live {radar_type}"] = played(bench, radar_type)
        bench.close()
    expected = found[f"live {CLOUD}"]
    assert all(np.isfinite(depth_m).any() for depth_m in expected), "no return reaches the network"
    for name, images in found.items():
        assert len(images) == len(DEPTH) * FRAMES
        for image, other in zip(images, expected, strict=True):
            np.testing.assert_array_equal(image, other, name)


def test_diagnostics_and_log_tell_what_is_read_of_a_scan(start: Callable[..., Any]) -> None:
    bench = start()
    bench.advertise(TOPIC, SCAN)
    bench.connect()
    bench.await_depth(send_scan(bench))
    assert np.isclose(next(reversed(bench.fake.radar_m.values()))[:, 2], [10, 20]).all()
    status = bench.send_until(lambda: bench.status(RADAR, "Hz on /radar/points"), send_scan(bench), what="its status")
    values = {value.key: value.value for value in status.values}
    assert values["type"] == SCAN
    assert values["field of the Doppler speed"] == "doppler_velocity"
    assert values["field of the RCS"] == "amplitude"
    line = (
        f"{RADAR}: reads {SCAN}: position from range azimuth elevation, Doppler speed from doppler_velocity, RCS from "
    )
    bench.until(lambda: [log for log in bench.logs if line + "amplitude" in log], what="its line")


def test_a_type_that_changes_while_the_node_runs_is_followed(start: Callable[..., Any], driver: Any) -> None:
    bench = start()
    bench.connect(TOPIC)

    def send(type_name: str, distance_m: float) -> None:
        columns = {"range": [distance_m, 50.0]}
        driver.send(TOPIC, scan(bench, **columns) if type_name == SCAN else bench.cloud((distance_m, 50.0)))
        bench.send_pair()

    def is_read(distance_m: float) -> bool:
        places = list(bench.fake.radar_m.values())[-1:]
        return any(len(xyz) == 2 and np.isclose(xyz[0, 2], distance_m) for xyz in places)

    for type_name, distance_m in ((CLOUD, 10.0), (SCAN, 20.0), (CLOUD, 30.0)):
        driver.advertise(TOPIC, type_name)
        again = partial(send, type_name, distance_m)
        bench.send_until(partial(is_read, distance_m), again, what=f"returns of {type_name}")
        bench.diagnostics.clear()
        status = bench.send_until(lambda: bench.status(RADAR, "Hz on /radar/points"), again, what="its status")
        assert {value.key: value.value for value in status.values}["type"] == type_name
        driver.unadvertise(TOPIC)
    for type_name in (SCAN, CLOUD):
        sentence = f"its topic is published as {type_name}, and read as that from now on"
        bench.until(lambda sentence=sentence: [log for log in bench.logs if sentence in log], what=sentence)
    assert not [log for log in bench.logs if "another type" in log]


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"range": [np.nan, 20.0]}, "got 1 returns with NaN or infinity"),
        ({"azimuth": [0.0, 45.0]}, "radar_fields to azimuth=azimuth[deg]"),
    ],
)
def test_what_is_wrong_with_a_scan_is_named(start: Callable[..., Any], columns: dict[str, Any], words: str) -> None:
    bench = start()
    bench.advertise(TOPIC, SCAN)
    bench.connect()
    bench.send_until(lambda: bench.status(RADAR, words), send_scan(bench, **columns), what="its status")
    bench.await_depth(send_scan(bench))


def test_a_scan_of_100_000_returns_is_thinned_and_a_larger_one_left_out(start: Callable[..., Any]) -> None:
    bench = start()
    bench.advertise(TOPIC, SCAN)
    bench.connect()
    for count, words in ((100_000, "got 80000 more: the nearest are used"), (250_000, "at most 4096 KiB in a scan")):
        many = encode_scan(build_message, {"range": np.linspace(5, 200, count)}, 0, "radar")

        def send(many: Any = many) -> None:
            many.header = bench.image().header
            many.header.frame_id = "radar"
            bench.send_pair(cloud=many)

        bench.send_until(lambda words=words: bench.status(RADAR, words), send, what=words)


def test_a_scan_near_by_is_proposed_and_another_type_is_named(
    start: Callable[..., Any], driver: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watchdog, "SILENCE_S", 0.3)
    bench = start()
    bench.until(lambda: bench.state == "active", what="the node")
    bench.advertise("radar/scan", SCAN)
    driver.advertise(TOPIC, "std_msgs/msg/Header")
    words = f"it is published as std_msgs/msg/Header: set radar_topics to a topic of {CLOUD} or {SCAN}"
    bench.until(lambda: bench.status(RADAR, words), what="another type")
    driver.unadvertise(TOPIC)
    words = "of this type there is /radar/scan: set radar_topics to it"
    bench.until(lambda: bench.status(RADAR, words), what="the proposal")


def test_a_scan_without_its_package_is_named_and_the_cloud_is_read_later(
    start: Callable[..., Any], driver: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subscriptions, "has_messages", lambda type_name: type_name != SCAN)
    bench = start()
    bench.until(lambda: bench.state == "active", what="the node")
    driver.advertise(TOPIC, SCAN)
    words = f"/radar/points is published as {SCAN}, which cannot be read since radar_msgs is not installed: install "
    status = bench.until(lambda: bench.status(RADAR, words), what="its status")
    assert "ros-jazzy-radar-msgs" in status.message
    assert status.level == b"\x02"
    driver.unadvertise(TOPIC)
    bench.connect()
    bench.await_depth()
    bench.send_until(lambda: bench.diagnostics[-1][RADAR].level == b"\x00", what="a status that is well")
    assert len([log for log in bench.logs if words in log]) <= 1


def test_an_intensity_that_is_likely_doppler_is_told(start: Callable[..., Any]) -> None:
    bench = start()
    bench.connect()
    rng = np.random.default_rng(3)

    def send() -> None:
        angle, distance = rng.uniform(-0.9, 0.9, 40), rng.uniform(5, 80, 40)
        speed = -(5 + bench.now_ns // 10**8 % 10)
        columns = {"x": distance * np.cos(angle), "y": distance * np.sin(angle), "z": np.zeros(40)}
        columns["intensity"] = speed * np.cos(angle)
        cloud = {name: values.astype(np.float32) for name, values in columns.items()}
        bench.send_pair(cloud=encode_points(build_message, cloud, bench.now_ns, "radar"))

    words = "set the parameter radar_fields to radial_speed=intensity rcs= if they are speeds"
    status = bench.send_until(lambda: bench.status(RADAR, words), send, what="its status")
    assert status.level == b"\x01"
    assert {value.key: value.value for value in status.values}["field of the RCS"] == "intensity"
    bench.until(lambda: [log for log in bench.logs if words in log], what="its line in the log")
