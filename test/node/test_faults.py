"""Sensors that fail: what depth comes out all the same, what diagnostics say, and that all is well afterwards."""

from __future__ import annotations

import itertools
import random
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from benchmarks.soak_figures import Counts
from radcam_depth_ros.messages import decode_depth
from radcam_depth_ros.node import watchdog

RADAR = "radar /radar/points"
OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"
WITH_RADAR, WITHOUT_RADAR = 3.0, 1.0
"""The made-up depth: the returns in view and 1 m more."""
RELIABLE = [
    word
    for topic, setting in itertools.product(("/image", "/radar/points"), ("reliability:=reliable", "depth:=100"))
    for word in ("-p", f"qos_overrides.{topic}.subscription.{setting}")
] + ["-p", "qos_overrides./depth/image_rect.publisher.depth:=100"]
"""So that exactly those messages are lost that a test leaves out."""


@pytest.fixture(scope="module")
def node(start_for_module: Callable[..., Any]) -> Iterator[Any]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(watchdog, "SILENCE_S", 0.3)
        patch.setattr(watchdog, "NO_OUTPUT_S", 0.4)
        bench = start_for_module(args=RELIABLE, max_wait_s=0.1)
        bench.connect()
        yield bench


@pytest.fixture
def bench(node: Any) -> Any:
    """The node with a session of its own, in which nothing came yet but the calibration."""
    begin(node, radar_time_offset_s=0.0)
    return node


@pytest.fixture
def patient(bench: Any) -> Iterator[Any]:
    """The same, where images wait for the next sweep however slow this machine is."""
    waits_s = bench.node.get_parameter("max_wait_s").value
    assert bench.set_parameter("max_wait_s", 10.0) == ""
    yield bench
    assert bench.set_parameter("max_wait_s", waits_s) == ""


def begin(bench: Any, radar_time_offset_s: float) -> None:
    """Starts a session in which whatever is sent from now on is heard."""
    assert bench.change_state("deactivate")
    bench.until(lambda: not any(map(bench.peer.count_subscribers, ("image", "radar/points"))), what="the end")
    assert bench.set_parameter("radar_time_offset_s", radar_time_offset_s) == ""
    assert bench.change_state("activate")
    bench.connect()
    frame_builder = bench.node._session.frame_builder
    bench.send_until(
        lambda: frame_builder.camera, lambda: bench.send("camera_info", bench.camera_info()), "calibration"
    )
    for heard in (bench.depth, bench.logs):
        heard.clear()
    bench.diagnostics.clear()
    bench.until(lambda: bench.diagnostics, what="diagnostics")


def settle(bench: Any, unreadable: int = 0) -> None:
    """Waits until all images that came are depth, or dropped."""
    session = bench.node._session

    def is_idle() -> bool:
        counts = session.frame_builder.counts
        are_read = all(
            session.used[part] == session.rates[part].count - (unreadable if part == "camera" else 0)
            for part in ("camera", RADAR)
        )
        are_frames = session.frames_in + session.images_unusable == counts.paired + counts.unmatched
        done = session.frames_out.count + session.frames_dropped + session.frames_failed
        return bool(are_read and are_frames and not counts.waiting and session.frames_in == done)

    wait(is_idle, "the end of the work")


def wait(condition: Callable[[], bool], what: str) -> None:
    """Waits for something in the node, in which the peer has no part."""
    deadline = time.monotonic() + 150
    while not condition():
        assert time.monotonic() < deadline, f"{what} did not come about"
        time.sleep(0.001)


def told(bench: Any, part: str) -> dict[str, str]:
    """The values of a line about a part that was made from now on."""
    bench.listens_since_ns = time.time_ns()
    bench.diagnostics.clear()
    bench.until(lambda: len(bench.diagnostics) > 1, what="diagnostics")
    return values(bench, part)


def values(bench: Any, part: str) -> dict[str, str]:
    return {value.key: value.value for value in bench.diagnostics[-1][part].values}


def depths(bench: Any) -> dict[int, float]:
    readings = [decode_depth(message) for message in bench.depth]
    return {reading.stamp_ns: float(reading.depth_m[0, 0]) for reading in readings}


def send(bench: Any, topic: str, message: Any) -> None:
    """Sends to the camera or the radar, and waits until the node has it."""
    session = bench.node._session
    rate = session.rates["camera" if topic == "image" else RADAR]
    count = rate.count
    bench.send(topic, message)
    wait(lambda: rate.count > count, f"a message on {topic}")


def await_health(bench: Any) -> None:
    bench.send_until(lambda: bench.diagnostics[-1]["health"].level == OK, what="health")


@pytest.mark.parametrize(
    ("stopped", "levels", "words"),
    [
        (("image",), {"camera": ERROR, RADAR: OK, "output": ERROR, "health": ERROR}, "ERROR: camera"),
        (
            ("radar/points",),
            {"camera": OK, RADAR: WARN, "pairing": WARN, "output": OK, "health": WARN},
            f"WARN: {RADAR}",
        ),
        (("image", "radar/points"), {"camera": ERROR, RADAR: WARN, "output": ERROR, "health": ERROR}, "ERROR: camera"),
    ],
    ids=["camera", "radar", "both"],
)
def test_sensors_that_stop_are_named_until_they_come_back(
    bench: Any, stopped: tuple[str, ...], levels: dict[str, bytes], words: str
) -> None:
    bench.await_depth()
    messages = {"image": bench.image, "radar/points": bench.cloud, "camera_info": bench.camera_info}

    def send_rest() -> None:
        for topic in messages.keys() - set(stopped):
            bench.send(topic, messages[topic]())

    def is_told() -> bool:
        return bool(bench.diagnostics and all(bench.diagnostics[-1][part].level == levels[part] for part in levels))

    bench.send_until(is_told, send_rest, what=f"the levels {levels}")
    lines = bench.diagnostics[-1]
    assert lines["health"].message.startswith(words)
    for topic, part in (("image", "camera"), ("radar/points", RADAR)):
        assert ("got nothing for" in lines[part].message) == (topic in stopped)
    if "image" in stopped:
        assert "no depth for" in lines["output"].message
        assert "sensor_msgs/msg/Image on /image (1 publisher)" in lines["output"].message
        bench.until(lambda: [line for line in bench.logs if "no depth for" in line])
        told(bench, "output")
        assert len([line for line in bench.logs if "no depth for" in line]) == 1
    else:
        bench.until(lambda: list(depths(bench).values())[-1] == WITHOUT_RADAR, what="depth of the image alone")
    await_health(bench)
    assert decode_depth(bench.await_depth()).depth_m[0, 0] == WITH_RADAR


@pytest.mark.parametrize("ahead_s", [0.5, -0.5])
def test_stamps_that_are_half_a_second_apart_are_named_with_what_helps(bench: Any, ahead_s: float) -> None:
    def send_apart() -> None:
        for _ in range(10):
            bench.now_ns += 100_000_000
            send(bench, "image", bench.image())
            image_ns = bench.now_ns
            bench.now_ns += round(ahead_s * 1e9)
            send(bench, "radar/points", bench.cloud())
            bench.now_ns = image_ns

    send_apart()
    words = "by when they arrive the stamps on /radar/points are"
    status = bench.until(lambda: bench.status("pairing", words), what="the offset")
    assert status.level == WARN
    pattern = rf"are (\d+) ms {'ahead of' if ahead_s > 0 else 'behind'} the images'.* radar_time_offset_s: (\S+)"
    (found,) = re.findall(pattern, status.message)
    assert [float(number) for number in found] == pytest.approx([500, -ahead_s], rel=0.2)
    bench.until(lambda: [line for line in bench.logs if words in line])
    assert float(values(bench, RADAR)["stamps ahead of the camera's [ms]"]) == pytest.approx(1e3 * ahead_s, rel=0.2)
    begin(bench, radar_time_offset_s=-ahead_s)
    send_apart()
    settle(bench)
    pairing = told(bench, "pairing")
    assert (pairing["unmatched"], pairing["/radar/points: dt p99 [ms]"]) == ("0", "0.0")
    assert bench.diagnostics[-1]["pairing"].level == OK
    assert set(depths(bench).values()) == {WITH_RADAR}


def test_images_that_wait_nearly_as_long_as_they_may_are_told(start: Callable[..., Any]) -> None:
    bench = start(max_wait_s=0.04)
    bench.connect()

    def send() -> None:
        cloud = bench.cloud()
        stamp_ns = bench.now_ns - 45_000_000  # the next one is as near, and comes later
        cloud.header.stamp.sec, cloud.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        bench.send_pair(cloud=cloud)

    status = bench.send_until(lambda: bench.status("pairing", "near max_wait_s, 0.04 s"), send, what="the wait")
    assert status.level == b"\x00"
    assert {"wait p50 [ms]", "wait p99 [ms]"} <= {value.key for value in status.values}


def test_duplicates_give_one_depth_each_and_are_counted(bench: Any) -> None:
    sent = []
    for _ in range(8):
        bench.now_ns += 100_000_000
        sent.append(bench.now_ns)
        for topic, message in (("radar/points", bench.cloud()), ("image", bench.image())):
            send(bench, topic, message)
            send(bench, topic, message)
        settle(bench)
    bench.until(lambda: len(bench.depth) >= len(sent), what="depth of all images")
    assert [int(stamp) for stamp in depths(bench)] == sent
    assert len(bench.depth) == len(sent)
    assert set(depths(bench).values()) == {WITH_RADAR}
    assert bench.until(lambda: bench.status("pairing", "a stamp of its own on each image")).level == WARN
    pairing = told(bench, "pairing")
    assert pairing["duplicates"] == pairing["/radar/points: duplicates"] == str(len(sent))
    await_health(bench)


def test_messages_in_another_order_find_their_own_all_the_same(bench: Any) -> None:
    start_ns, sent = bench.now_ns, []
    for step in range(1, 13, 2):
        for topic, make in (("radar/points", bench.cloud), ("image", bench.image)):
            for swapped in (step + 1, step):
                bench.now_ns = start_ns + swapped * 100_000_000
                send(bench, topic, make())
                settle(bench)
        sent += [start_ns + swapped * 100_000_000 for swapped in (step, step + 1)]
    bench.now_ns = max(sent)
    bench.until(lambda: len(bench.depth) >= len(sent), what="depth of all images")
    assert sorted(depths(bench)) == sent
    assert set(depths(bench).values()) == {WITH_RADAR}
    pairing = told(bench, "pairing")
    assert (pairing["backward jumps"], pairing["/radar/points: dt p99 [ms]"]) == ("0", "0.0")
    assert int(pairing["out of order"]) <= len(sent) // 2
    assert bench.diagnostics[-1]["pairing"].level == OK


def test_of_lossy_sensors_every_image_that_comes_gives_depth(bench: Any) -> None:
    rng, sent = random.Random(7), []
    for _ in range(40):
        bench.now_ns += 100_000_000
        if rng.random() > 0.3:
            send(bench, "radar/points", bench.cloud())
        if rng.random() > 0.3:
            send(bench, "image", bench.image())
            sent.append(bench.now_ns)
            settle(bench)
    bench.until(lambda: len(bench.depth) >= len(sent), what="depth of all images")
    assert list(depths(bench)) == sent
    pairing = told(bench, "pairing")
    assert (pairing["/radar/points: dt p50 [ms]"], pairing["/radar/points: dt p99 [ms]"]) == ("0.0", "100.0")
    assert set(depths(bench).values()) == {WITH_RADAR, WITHOUT_RADAR}
    for part in ("camera", RADAR):
        assert 20 < int(values(bench, part)["missing between stamps [%]"]) < 40
    await_health(bench)


def test_a_fast_camera_and_a_slow_radar_are_paired_as_near_as_they_come(patient: Any) -> None:
    sent = []
    for step in range(61):
        patient.now_ns += 1_000_000_000 // 60
        if step % 12 == 0:
            send(patient, "radar/points", patient.cloud())
        sent.append(patient.now_ns)
        send(patient, "image", patient.image())
    settle(patient)
    patient.until(lambda: patient.depth and list(depths(patient))[-1] == sent[-1], what="depth of the last image")
    assert depths(patient).keys() <= set(sent)
    assert set(depths(patient).values()) == {WITH_RADAR}
    pairing = told(patient, "pairing")
    assert 80 < float(pairing["/radar/points: dt p99 [ms]"]) <= 100
    assert 30 < float(pairing["/radar/points: dt p50 [ms]"]) < 70
    assert (pairing["paired"], pairing["unmatched"], pairing["/radar/points: late sweeps"]) == ("61", "0", "0")
    assert patient.diagnostics[-1]["pairing"].level == OK


def test_every_image_is_depth_or_a_drop_with_a_cause(bench: Any) -> None:
    unreadable = bench.image()
    unreadable.encoding = "of no camera"

    bench.now_ns += 100_000_000
    for message in (unreadable, bench.image(), bench.image()):
        send(bench, "image", message)
    settle(bench, unreadable=1)
    bench.fake.error = ZeroDivisionError("of the network")
    bench.now_ns += 100_000_000
    send(bench, "image", bench.image())
    settle(bench, unreadable=1)
    bench.fake.error = None
    # A picture of another size than camera_info says.
    bench.now_ns += 100_000_000
    small = bench.image()
    small.width, small.step, small.data = 48, 144, small.data[: 144 * small.height]
    send(bench, "image", small)
    bench.until(lambda: bench.node._session.images_unusable, what="its drop")
    settle(bench, unreadable=1)
    output = told(bench, "output")
    causes = ("unreadable", "duplicate", "no calibration or transform", "failed")
    assert (output["images"], output["frames out"], output["dropped: overload"]) == ("5", "1", "0")
    assert [output[f"dropped: {cause}"] for cause in causes] == ["1"] * len(causes)
    counts = Counts.read({part: values(bench, part) for part in bench.diagnostics[-1]})
    assert counts is not None  # the names that a soak goes by
    assert (counts.heard, counts.refused, counts.pairs, counts.out, counts.is_settled) == (5, 3, 2, 1, True)
    await_health(bench)


def test_how_long_a_frame_took_is_told_in_parts_and_the_tutorial_lists_all_statuses(bench: Any) -> None:
    heard: dict[str, list[float]] = {part: [] for part in ("latency", "decode", "wait", "inference", "encode")}
    for part, times in heard.items():
        bench.subscribe(f"debug/{part}_ms", "std_msgs/msg/Float32", lambda message, of=times: of.append(message.data))
    bench.fake.seconds = 0.02
    bench.send_until(lambda: all(len(times) >= 3 for times in heard.values()), what="times")
    settle(bench)
    bench.fake.seconds = 0.0
    for times in heard.values():
        times.clear()
    bench.now_ns += 100_000_000
    bench.send_pair()
    bench.until(lambda: all(heard.values()), what="a frame's times")
    latest = {part: times[0] for part, times in heard.items()}
    assert latest["latency"] == pytest.approx(sum(latest.values()) - latest["latency"], rel=1e-4)
    inference = told(bench, "inference")
    page = (Path(__file__).parents[2] / "docs/tutorials/troubleshooting.md").read_text(encoding="utf-8")
    table = page.split("| status | values |")[1].split("\n\n")[0]
    listed = {
        name.split(" ")[0] for row in table.splitlines()[2:] for name in re.findall(r"`([^`]+)`", row.split("|")[1])
    }
    assert {name.split(" ")[0] for name in bench.diagnostics[-1]} == listed - {"odometry"}
    assert {f"{part} {name} [ms]" for part in heard for name in ("p50", "p95", "p99")} <= inference.keys()
    assert float(inference["inference p99 [ms]"]) >= 20
