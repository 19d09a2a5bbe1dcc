from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from radcam_depth_ros.encoder import OUTPUTS
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.node.depth_node import WARM_UP_SIZE, _canonical_camera


def test_depth_comes_from_a_node_that_was_only_started(start: Callable[..., Any]) -> None:
    bench = start()
    bench.connect()
    depth = bench.await_depth()
    assert (depth.height, depth.width, depth.encoding, depth.header.frame_id) == (64, 96, "32FC1", "camera")
    assert bench.state == "active"
    bench.send_until(lambda: bench.status("inference", "ms from image to depth"))
    parts = {"health", "camera", "radar /radar/points", "calibration", "pairing", "inference", "output", "model"}
    assert bench.diagnostics[-1].keys() == parts
    assert {name: status.message for name, status in bench.diagnostics[-1].items() if status.level != b"\x00"} == {}


def test_every_output_has_the_stamp_and_frame_of_its_image(
    start: Callable[..., Any], make_estimator: Callable[..., Any]
) -> None:
    bench = start(lambda config: make_estimator(config, tells_classes=True))
    inbox: dict[str, list[Any]] = {}
    for output in OUTPUTS.values():
        bench.subscribe(output.topic, output.type_name, inbox.setdefault(output.topic, []).append)
    bench.connect()
    bench.send_until(lambda: all(inbox.values()), what="all outputs")
    for topic, messages in inbox.items():
        assert messages[-1].header.frame_id == "camera", topic
        assert messages[-1].header.stamp.sec >= 100, topic
        if topic == "depth/image_rect/compressedDepth":
            assert messages[-1].format == "32FC1; compressedDepth png"
        else:
            assert (messages[-1].width, messages[-1].height) == ((96 * 64, 1) if topic == "depth/points" else (96, 64))


def test_preview_points_and_classes_are_made_only_while_somebody_subscribes(
    start: Callable[..., Any], make_estimator: Callable[..., Any]
) -> None:
    bench = start(lambda config: make_estimator(config, tells_classes=True))
    bench.connect()
    asked: dict[str, set[str]] = {}
    pipeline = bench.node._session.pipeline

    def noting(name: str) -> Callable[..., Any]:
        stage = getattr(pipeline, name)
        return lambda *given: (asked.update({name: set(given[-1])}), stage(*given))[1]

    def are_asked(*on_demand: str) -> bool:
        wanted = {name for name, output in OUTPUTS.items() if not output.is_on_demand} | {*on_demand}
        return asked == {"estimate": wanted, "encode": wanted}

    pipeline.estimate, pipeline.encode = noting("estimate"), noting("encode")
    bench.await_depth()
    assert are_asked()
    bench.subscribe("depth/preview", "sensor_msgs/msg/Image", lambda _: None)
    bench.send_until(lambda: are_asked("preview"), what="a preview")
    bench.subscribe("semantics/image", "sensor_msgs/msg/Image", lambda _: None)
    bench.send_until(lambda: are_asked("preview", "semantics"), what="classes")


def test_compressed_images_on_the_topic_beside(start: Callable[..., Any]) -> None:
    from radcam_depth_ros.messages import encode_compressed_image
    from radcam_depth_ros.node.topics.factory import build_message

    bench = start(image_transport="compressed", args=["-r", "image:=front/image_raw"])
    bench.advertise("/front/image_raw/compressed", "sensor_msgs/msg/CompressedImage")
    bench.connect("image")

    def send() -> None:
        import numpy as np

        bench.send_pair()
        pixels = np.full((64, 96, 3), 99, np.uint8)
        message = encode_compressed_image(build_message, pixels, bench.now_ns, "camera")
        bench.send("/front/image_raw/compressed", message)

    assert bench.await_depth(send).encoding == "32FC1"


def test_all_transitions_again_and_again_leave_nothing_behind(start: Callable[..., Any]) -> None:
    bench = start()
    bench.connect()
    bench.await_depth()
    threads = threading.active_count()
    subscriptions, publishers = len(list(bench.node.subscriptions)), len(list(bench.node.publishers))
    for _ in range(10):
        for label, state in (
            ("deactivate", "inactive"),
            ("activate", "active"),
            ("deactivate", "inactive"),
            ("cleanup", "unconfigured"),
            ("configure", "inactive"),
            ("activate", "active"),
        ):
            assert bench.change_state(label)
            assert bench.state == state
    assert threading.active_count() == threads
    assert len(list(bench.node.subscriptions)) == subscriptions
    assert len(list(bench.node.publishers)) == publishers
    bench.await_depth()
    assert bench.change_state("shutdown")
    assert bench.state == "finalized"
    assert threading.active_count() == threads - 1


def test_an_inactive_node_is_silent_and_says_so(start: Callable[..., Any]) -> None:
    bench = start(autostart=False)
    bench.until(lambda: bench.status("camera", "the node is unconfigured"))
    assert bench.state == "unconfigured"
    assert bench.fake is None
    assert bench.change_state("configure")
    bench.until(lambda: bench.status("camera", "the node is inactive"))
    status = bench.status("model", "made up")
    told = [(value.key, value.value) for value in status.values]
    assert told == list(bench.fake.computation.values())
    assert not list(bench.node.subscriptions) or all("image" not in s.topic_name for s in bench.node.subscriptions)


@pytest.mark.parametrize(("stop", "go"), [(["deactivate"], []), (["deactivate", "cleanup"], ["configure"])])
def test_parameters_are_set_while_the_node_is_not_active(
    start: Callable[..., Any], stop: list[str], go: list[str]
) -> None:
    bench = start()
    bench.until(lambda: bench.state == "active")
    refusal = bench.set_parameter("camera_frame", "eye")
    assert refusal == (
        "camera_frame cannot change now: the node is active; deactivate it first, then activate it again "
        "(ros2 lifecycle set /radcam_depth deactivate)"
    )
    assert all(bench.change_state(label) for label in stop)
    assert "raw, compressed, compressed_topic, got 'zip'" in bench.set_parameter("image_transport", "zip")
    assert bench.set_parameter("camera_frame", "eye") == ""
    assert all(bench.change_state(label) for label in (*go, "activate"))
    bench.connect()
    assert bench.await_depth(lambda: bench.send_pair(bench.image(frame_id=""))).header.frame_id == "eye"


@pytest.mark.parametrize(
    ("line", "expected", "mended"),
    [
        ("image_transport: zip", "image_transport must be one of raw, compressed, compressed_topic, got 'zip'", "raw"),
        ("max_wait_s: 99", "the parameter max_wait_s must be within 0 and 10, got 99", 0.02),
        ("threads: two", "the parameter threads must be a whole number, got 'two'", 1),
        ("image_topic: 'a b'", "expected the name of a topic in the parameters, got 'a b'", "image"),
        ("preview_near_m: 90.0", "0 < preview_near_m < preview_far_m", 1.0),
    ],
    ids=lambda value: str(value).split(":")[0],
)
def test_a_parameter_file_with_a_value_that_cannot_be_used(
    start: Callable[..., Any], tmp_path: Path, line: str, expected: str, mended: Any
) -> None:
    path = tmp_path / "node.yaml"
    path.write_text(f"radcam_depth:\n  ros__parameters:\n    {line}\n", encoding="utf-8")
    bench = start(args=["--params-file", str(path)], max_wait_s=None)
    bench.until(lambda: bench.status("model", expected), what=expected)
    assert bench.state == "unconfigured"
    bench.until(lambda: [log for log in bench.logs if expected in log])
    assert len([log for log in bench.logs if expected in log]) == 1
    assert bench.set_parameter(line.split(":")[0], mended) == ""
    assert bench.change_state("configure")
    assert bench.change_state("activate")
    bench.connect()
    bench.await_depth()


def corrupt(path: Path) -> str:
    (path / "broken.safetensors").write_bytes(b"\x00" * 100)
    (path / "broken.yaml").write_text("network: baff\n", encoding="utf-8")
    return str(path / "broken.safetensors")


def foreign(path: Path) -> str:
    (path / "other.pt").write_bytes(b"PK\x03\x04 this is no network")
    return str(path / "other.pt")


def another_model(path: Path) -> str:
    (path / "other.onnx").write_bytes(b"\x08\x09")
    return str(path / "other.onnx")


def absent(path: Path) -> str:
    return str(path / "nothing.safetensors")


@pytest.mark.parametrize("write", [corrupt, foreign, another_model, absent])
def test_a_weight_file_that_cannot_be_loaded(
    start: Callable[..., Any], make_estimator: Callable[..., Any], tmp_path: Path, write: Callable[[Path], str]
) -> None:
    bench = start(
        lambda config: Estimator(config) if config.model_file else make_estimator(config), model_file=write(tmp_path)
    )
    status = bench.until(lambda: bench.status("model", "cannot be configured"), what="a line about the model")
    assert status.level == b"\x02"
    assert bench.state == "unconfigured"
    bench.until(lambda: [log for log in bench.logs if status.message in log])
    assert len([log for log in bench.logs if "cannot be configured" in log]) == 1
    assert bench.set_parameter("model_file", "") == ""
    assert bench.change_state("configure")
    assert bench.change_state("activate")
    bench.connect()
    bench.await_depth()


@pytest.mark.parametrize(("only", "expected"), [(None, WARM_UP_SIZE), ((224, 416), (416, 224))])
def test_a_network_of_one_size_is_warmed_up_at_that_size(
    only: tuple[int, int] | None, expected: tuple[int, int], make_estimator: Callable[..., Any]
) -> None:
    camera = _canonical_camera(make_estimator(EstimatorConfig(), only_size=only))
    assert (camera.width, camera.height) == expected
