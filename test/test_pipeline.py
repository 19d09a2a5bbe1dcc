from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_drive import CAMERA, CAMERA_FROM_RADAR, PERIOD_NS, START_NS, small_image, small_messages, small_returns

from radcam_depth_ros.bags import factory
from radcam_depth_ros.encoder import OUTPUTS, Encoder, EncoderError, OutputConfig
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.frame import DepthResult, Frame, RadarReturns, RadcamDepthError
from radcam_depth_ros.frame_builder import FrameBuilder, FrameBuilderConfig, FrameBuilderError
from radcam_depth_ros.geometry import ground_coefficients
from radcam_depth_ros.messages import (
    StampedTransform,
    decode_classes,
    decode_depth,
    decode_image,
    encode_points,
    encode_transforms,
)
from radcam_depth_ros.pipeline import Pipeline

CONFIG = FrameBuilderConfig(image="/camera/image_raw", camera_info="/camera/camera_info", radars=("/radar/points",))
TF = encode_transforms(factory, [StampedTransform("camera", "radar", 0, CAMERA_FROM_RADAR)])


@pytest.fixture(scope="module")
def estimator(small_weights: Path) -> Estimator:
    return Estimator(EstimatorConfig(model_file=str(small_weights)))


def feed(pipeline: Pipeline, index: int, **changes: Any) -> tuple[Frame, ...]:
    """One frame's messages; `changes` are attributes of the message on the topic that ends so, e.g. image_raw={...}."""
    frames: tuple[Frame, ...] = ()
    for topic, _, message, time_ns in small_messages(factory, index):
        for name, value in changes.get(topic.rsplit("/", 1)[-1], {}).items():
            object.__setattr__(message, name, value)
        frames += pipeline.build(topic, message, time_ns)
    return frames + pipeline.frame_builder.expire(START_NS + index * PERIOD_NS + 150_000_000)


def make(estimator: Estimator, config: FrameBuilderConfig = CONFIG) -> Pipeline:
    return Pipeline(FrameBuilder(config), estimator, Encoder(OutputConfig(), factory))


def primed(estimator: Estimator, config: FrameBuilderConfig = CONFIG) -> Pipeline:
    pipeline = make(estimator, config)
    pipeline.build("/tf_static", TF, 0)
    return pipeline


def process(pipeline: Pipeline, frame: Frame, *on_demand: str) -> tuple[DepthResult | None, dict[str, Any]]:
    """What comes of a frame where these outputs are subscribed to."""
    wanted = {name for name, output in OUTPUTS.items() if not output.is_on_demand} | {*on_demand}
    result = pipeline.estimate(frame, wanted)
    return result, {} if result is None else pipeline.encode(frame, result, wanted)


def test_messages_become_frames_and_frames_messages(estimator: Estimator) -> None:
    pipeline = primed(estimator)
    (frame,) = feed(pipeline, 0)
    np.testing.assert_array_equal(frame.image, small_image(0))
    np.testing.assert_allclose(frame.radar.xyz_m, CAMERA_FROM_RADAR.apply(small_returns(0)), atol=1e-6)
    np.testing.assert_allclose(frame.radar.age_s, 0.02, atol=1e-6)
    assert (frame.camera, frame.frame_id, frame.stamp_ns) == (CAMERA, "camera", START_NS)
    assert frame.radar_counts == (4,)
    result, messages = process(pipeline, frame, "compressed_depth", "preview", "points")
    assert result is not None
    depth = decode_depth(messages["depth"])
    assert (depth.stamp_ns, depth.frame_id) == (START_NS, "camera")
    np.testing.assert_array_equal(depth.depth_m, result.dense)
    assert messages["depth_camera_info"].width == CAMERA.width
    assert messages["preview"].encoding == "rgb8"
    assert messages["points"].width == CAMERA.width * CAMERA.height
    assert messages.keys() == OUTPUTS.keys() - {"semantics"}
    assert process(pipeline, frame)[1].keys() == messages.keys() - {"compressed_depth", "preview", "points"}


def test_the_class_image_is_made_where_the_network_tells_and_somebody_wants_it(
    estimator: Estimator, small_structured: Path
) -> None:
    telling = Estimator(EstimatorConfig(model_file=str(small_structured)))
    assert (estimator.tells_classes, telling.tells_classes) == (False, True)
    pipeline = primed(telling)
    (frame,) = feed(pipeline, 0)
    assert "semantics" not in process(pipeline, frame)[1]
    result, messages = process(pipeline, frame, "semantics")
    assert result is not None
    image = messages["semantics"]
    assert (image.encoding, image.width, image.height) == ("mono8", CAMERA.width, CAMERA.height)
    assert image.header == messages["depth"].header
    np.testing.assert_array_equal(decode_classes(image).classes, result.classes)
    assert "semantics" not in process(primed(estimator), frame, "semantics")[1]


def test_outputs_change_while_frames_come(estimator: Estimator) -> None:
    pipeline = primed(estimator)
    (frame,) = feed(pipeline, 0)
    _, before = process(pipeline, frame, "preview", "points")
    output = OutputConfig("16UC1", "grey", 5.0, 50.0, points_stride=8, points_near_m=1.0, points_far_m=900.0)
    pipeline.adjust(replace(CONFIG, without_radar="hold"), estimator.config, output)
    result, after = process(pipeline, frame, "preview", "points")
    assert result is not None
    encodings = (before["depth"].encoding, after["depth"].encoding, after["semi_dense"].encoding)
    assert encodings == ("32FC1", "16UC1", "16UC1")
    grey = decode_image(after["preview"]).image
    assert (grey[..., 0] == grey[..., 2]).all()
    dense = result.dense[4::8, 4::8]
    assert after["points"].width == ((dense >= 1) & (dense <= 900)).sum() < before["points"].width / 60
    with pytest.raises(FrameBuilderError, match="without_radar, max_hold_s and limits of pairing can change"):
        pipeline.adjust(replace(CONFIG, image="/other"), estimator.config, output)


def test_an_image_without_radar_is_suppressed_where_that_is_wanted(
    estimator: Estimator, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = replace(CONFIG, without_radar="suppress")
    pipeline = primed(estimator, config)
    (frame,) = feed(pipeline, 0)
    assert process(pipeline, frame)[0] is not None
    behind = replace(frame, radar=RadarReturns.from_points([[0.0, 0.0, -5.0]]), radar_counts=())
    assert process(pipeline, behind)[0] is None
    empty = replace(frame, radar=RadarReturns.empty(), radar_counts=())
    monkeypatch.setattr(estimator, "run", lambda inputs: pytest.fail("the network ran for nothing"))
    assert process(pipeline, empty)[0] is None
    monkeypatch.undo()
    pipeline.adjust(CONFIG, estimator.config, OutputConfig())
    assert process(pipeline, empty)[0] is not None


def test_extrinsics_and_height_by_parameter(estimator: Estimator) -> None:
    numbers = (*CAMERA_FROM_RADAR.translation, *CAMERA_FROM_RADAR.quaternion)
    config = replace(CONFIG, camera_from_radar=numbers, camera_height_m=1.4, camera_pitch_deg=2.0)
    (frame,) = feed(make(estimator, config), 0)
    np.testing.assert_allclose(frame.radar.xyz_m, CAMERA_FROM_RADAR.apply(small_returns(0)), atol=1e-5)
    assert frame.ground.height_m == 1.4
    assert frame.ground.up[2] == pytest.approx(-np.sin(np.radians(2)))
    assert frame.ground.is_assumed, "the roll is not told"


@pytest.mark.parametrize(
    ("tilt", "is_assumed"),
    [((None, None), True), ((1.0, None), True), ((None, 0.0), True), ((0.0, 0.0), False), ((-1.0, 2.0), False)],
)
def test_a_road_is_told_once_height_pitch_and_roll_are(
    estimator: Estimator, tilt: tuple[float | None, float | None], is_assumed: bool
) -> None:
    numbers = (*CAMERA_FROM_RADAR.translation, *CAMERA_FROM_RADAR.quaternion)
    config = replace(CONFIG, camera_from_radar=numbers, camera_height_m=1.4)
    config = replace(config, camera_pitch_deg=tilt[0], camera_roll_deg=tilt[1])
    (frame,) = feed(make(estimator, config), 0)
    assert (frame.ground.height_m, frame.ground.is_assumed) == (1.4, is_assumed)
    assert ground_coefficients(frame.ground, frame.camera)[3] == (0.0 if is_assumed else 1.0)


def test_the_road_comes_from_the_footprint_frame(estimator: Estimator) -> None:
    pipeline = primed(estimator)
    down = replace(CAMERA_FROM_RADAR, translation=np.array([0.0, 1.6, 0.0]))
    link = StampedTransform("camera", "base_footprint", 0, down)
    pipeline.build("/tf_static", encode_transforms(factory, [link]), 0)
    (frame,) = feed(pipeline, 0)
    assert frame.ground.height_m == pytest.approx(1.6)


def test_no_radar_topic_at_all(estimator: Estimator) -> None:
    pipeline = make(estimator, replace(CONFIG, radars=()))
    _, _, info, _ = small_messages(factory, 0)
    pipeline.build(info[0], info[2], info[3])
    (frame,) = feed(pipeline, 0)
    assert len(frame.radar) == 0


def test_a_silent_radar_does_not_stop_the_camera(estimator: Estimator) -> None:
    pipeline = primed(estimator)
    feed(pipeline, 0)
    _, image, info, _ = small_messages(factory, 5)
    pipeline.build(info[0], info[2], info[3])
    assert pipeline.build(image[0], image[2], image[3]) == ()
    (frame,) = pipeline.frame_builder.expire(image[3] + 150_000_000)
    assert len(frame.radar) == 0
    assert np.isfinite(estimator.estimate(frame).dense).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"image_raw": {"encoding": "blue8"}}, "blue8"),
        ({"image_raw": {"data": np.zeros(5, np.uint8)}}, "5"),
        ({"image_raw": {"step": 3}}, "step"),
        ({"camera_info": {"k": np.zeros(9), "p": np.zeros(12)}}, "camera_info|focal"),
        ({"points": {"fields": []}}, "x y z|fields"),
    ],
)
def test_bad_messages_are_named_and_the_next_good_one_works(
    estimator: Estimator, changes: dict[str, Any], message: str
) -> None:
    pipeline = primed(estimator)
    with pytest.raises(RadcamDepthError, match=message):
        feed(pipeline, 0, **changes)
    # Without its camera_info the image that waits is of no use either.
    with suppress(FrameBuilderError):
        pipeline.frame_builder.expire(START_NS + PERIOD_NS * 2)
    frames: tuple[Frame, ...] = ()
    for index in (3, 4):
        frames += feed(pipeline, index)
    assert frames
    assert np.isfinite(estimator.estimate(frames[-1]).dense).all()


def test_what_is_missing_is_named(estimator: Estimator) -> None:
    with pytest.raises(FrameBuilderError, match=r"nothing came on /tf_static.*camera_from_radar"):
        feed(make(estimator), 0)
    pipeline = primed(estimator)
    _, image, _, _ = small_messages(factory, 0)
    pipeline.build(image[0], image[2], image[3])
    with pytest.raises(FrameBuilderError, match="no usable camera_info on '/camera/camera_info'"):
        pipeline.frame_builder.expire(image[3] + 150_000_000)


def test_empty_frame_ids_take_the_parameter(estimator: Estimator) -> None:
    pipeline = primed(estimator)
    header = small_messages(factory, 0)[1][2].header
    nameless = type(header)(stamp=header.stamp, frame_id="")
    with pytest.raises(FrameBuilderError, match="camera_frame"):
        feed(pipeline, 0, image_raw={"header": nameless})
    pipeline = primed(estimator, replace(CONFIG, camera_frame="camera", radar_frame="radar"))
    (frame,) = feed(pipeline, 0, image_raw={"header": nameless})
    assert frame.frame_id == "camera"


def test_an_image_of_another_size_is_named_and_the_next_works(estimator: Estimator) -> None:
    pipeline = primed(estimator)
    feed(pipeline, 0)
    small = {"width": 32, "height": 32, "step": 96, "data": np.zeros(32 * 96, np.uint8)}
    with pytest.raises(RadcamDepthError, match="32"):
        feed(pipeline, 1, image_raw=small)
    assert feed(pipeline, 2)


def test_a_frame_that_fails_does_not_take_another_along(estimator: Estimator) -> None:
    pipeline = primed(estimator)
    for index in (0, 1):
        for topic, _, message, time_ns in small_messages(factory, index)[1:3]:
            if index == 1 and topic.endswith("image_raw"):
                object.__setattr__(message, "width", 32)
                object.__setattr__(message, "step", 96)
            assert pipeline.build(topic, message, time_ns) == ()
    late = START_NS + 10 * PERIOD_NS
    assert len(pipeline.frame_builder.expire(late)) == 1
    with pytest.raises(RadcamDepthError, match="32"):
        pipeline.frame_builder.expire(late)
    assert pipeline.frame_builder.expire(late) == ()


def test_points_that_are_no_points(estimator: Estimator) -> None:
    pipeline = primed(estimator)
    bad = np.array([[np.nan, 0, 0], [np.inf, 1, 0], [-5, 0, 0], [9, 0, 0]], np.float32)
    cloud = encode_points(factory, dict(zip("xyz", bad.T, strict=True)), START_NS, "radar")
    pipeline.build("/radar/points", cloud, START_NS)
    _, image, info, _ = small_messages(factory, 0)
    pipeline.build(info[0], info[2], info[3])
    frames = pipeline.build(image[0], image[2], image[3]) + pipeline.frame_builder.expire(START_NS + PERIOD_NS * 2)
    result = estimator.estimate(frames[0])
    assert result.radar_in_view == 1
    assert np.isfinite(result.dense).all()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"camera_from_radar": (1.0, 2.0)}, "7 numbers, got 2"),
        ({"camera_height_m": -1.0}, "camera_height_m"),
        ({"radars": ("/a", "/a")}, "different topics"),
    ],
)
def test_settings_that_do_not_fit(values: dict[str, Any], message: str) -> None:
    with pytest.raises((EncoderError, FrameBuilderError), match=message):
        FrameBuilderConfig(**values)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"depth_encoding": "8UC1"}, "depth_encoding must be one of 32FC1, 16UC1, got '8UC1'"),
        ({"preview_colormap": "pink"}, "preview_colormap must be one of turbo, .*grey, got 'pink'"),
        ({"preview_near_m": 9.0, "preview_far_m": 3.0}, "preview_near_m < preview_far_m, got 9.0 and 3.0"),
        ({"points_stride": 0}, "points_stride must be 1"),
        ({"points_near_m": 9.0, "points_far_m": 9.0}, "points_near_m < points_far_m, got 9.0 and 9.0"),
    ],
)
def test_ways_to_write_that_do_not_fit(values: dict[str, Any], message: str) -> None:
    with pytest.raises(EncoderError, match=message):
        OutputConfig(**values)
