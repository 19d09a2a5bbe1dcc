from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from small_drive import (
    CAMERA,
    CAMERA_FROM_RADAR,
    PERIOD_NS,
    START_NS,
    doppler_as_intensity,
    without_radar_stamps,
    write_changed,
)

from radcam_depth_ros import cli
from radcam_depth_ros.bags import BagError, BagReader, BagWriter, factory
from radcam_depth_ros.classes import CLASS_NAMES
from radcam_depth_ros.drive import DriveError, DriveSettings, DriveWarning, read_samples
from radcam_depth_ros.encoder import OUTPUTS, OutputConfig, Replayed
from radcam_depth_ros.estimator import Estimator, EstimatorConfig, EstimatorError, NetworkInputs
from radcam_depth_ros.frame import Frame, RadcamDepthError
from radcam_depth_ros.frame_builder import FrameBuilderConfig
from radcam_depth_ros.messages import (
    MessageError,
    StampedTransform,
    decode_classes,
    decode_depth,
    decode_image,
    encode_transforms,
)
from radcam_depth_ros.pairing import PairingConfig
from radcam_depth_ros.pipeline import Pipeline
from radcam_depth_ros.replay import ReplayOptions, replay

WriteDrive = Callable[..., Path]
OPTIONAL = tuple(name for name, output in OUTPUTS.items() if output.replayed is Replayed.WITH_OPTION)


@pytest.fixture(scope="module", params=["float32", "bfloat16"])
def estimator(small_weights: Path, request: pytest.FixtureRequest) -> Estimator:
    return Estimator(EstimatorConfig(model_file=str(small_weights), precision=request.param))


def depths(path: Path, topic: str = "/depth/image_rect") -> dict[int, np.ndarray]:
    with BagReader(path) as reader:
        readings = [decode_depth(message.message) for message in reader.messages([topic])]
    return {reading.stamp_ns: reading.depth_m for reading in readings}


def test_every_image_gets_its_depth_and_twice_gives_the_same(
    tmp_path: Path, write_drive: WriteDrive, estimator: Estimator
) -> None:
    drive = write_drive(tmp_path / "drive.mcap")
    seen: list[tuple[int, int]] = []
    summary = replay(drive, tmp_path / "a.mcap", estimator, progress=lambda done, total: seen.append((done, total)))
    assert (summary.images, summary.frames, summary.without_radar) == (5, 5, 0)
    assert seen == [(index, 5) for index in range(1, 6)]
    replay(drive, tmp_path / "b", estimator, options=ReplayOptions(also=OPTIONAL))
    first, second = depths(tmp_path / "a.mcap"), depths(tmp_path / "b")
    assert list(first) == [START_NS + index * 100_000_000 for index in range(5)]
    for stamp, depth in first.items():
        np.testing.assert_array_equal(depth, second[stamp])
    with BagReader(tmp_path / "b") as reader:
        assert {(topic.name, topic.type_name) for topic in reader.topics} == {
            (f"/{output.topic}", output.type_name) for output in OUTPUTS.values() if not output.needs_classes
        }


def test_classes_are_written_where_the_network_tells_them(
    tmp_path: Path, write_drive: WriteDrive, small_structured: Path
) -> None:
    drive = write_drive(tmp_path / "drive.mcap", frames=2)
    replay(drive, tmp_path / "out.mcap", Estimator(EstimatorConfig(model_file=str(small_structured))))
    with BagReader(tmp_path / "out.mcap") as reader:
        readings = [decode_classes(message.message) for message in reader.messages(["/semantics/image"])]
    assert [reading.stamp_ns for reading in readings] == [START_NS, START_NS + PERIOD_NS]
    for reading in readings:
        assert reading.classes.shape == (CAMERA.height, CAMERA.width)
        assert reading.classes.max() < len(CLASS_NAMES)


def test_outputs_as_they_are_asked_for(tmp_path: Path, write_drive: WriteDrive, estimator: Estimator) -> None:
    drive = write_drive(tmp_path / "drive.mcap", frames=1)
    output = OutputConfig(preview_colormap="grey", points_stride=8)
    replay(drive, tmp_path / "out.mcap", estimator, options=ReplayOptions(also=OPTIONAL, output=output))
    with BagReader(tmp_path / "out.mcap") as reader:
        found = {message.topic: message.message for message in reader.messages()}
    assert found["/depth/points"].width == CAMERA.width * CAMERA.height // 64
    preview = decode_image(found["/depth/preview"]).image
    assert (preview[..., 0] == preview[..., 1]).all()


def test_the_verb_has_an_option_for_each_output_that_is_written_with_one() -> None:
    assert set(OPTIONAL) <= inspect.signature(cli.replay).parameters.keys()


def test_images_without_radar_have_no_depth_where_they_are_suppressed(
    tmp_path: Path, write_drive: WriteDrive, estimator: Estimator
) -> None:
    drive = write_drive(tmp_path / "drive.mcap", frames=3)
    settings = DriveSettings(
        FrameBuilderConfig(without_radar="suppress", pairing=PairingConfig(max_time_offset_s=0.01))
    )
    seen: list[int] = []
    summary = replay(drive, tmp_path / "out.mcap", estimator, settings, progress=lambda done, _: seen.append(done))
    assert (summary.images, summary.frames, summary.without_radar, seen) == (3, 0, 3, [1, 2, 3])
    held = DriveSettings(FrameBuilderConfig(without_radar="hold", pairing=PairingConfig(max_time_offset_s=0.03)))
    assert replay(drive, tmp_path / "held.mcap", estimator, held).without_radar == 0


def test_where_the_radar_is_may_come_by_tf(tmp_path: Path, write_drive: WriteDrive, estimator: Estimator) -> None:
    drive = write_drive(tmp_path / "drive.mcap", frames=2, without=("/tf_static",))
    message = encode_transforms(factory, [StampedTransform("camera", "radar", START_NS, CAMERA_FROM_RADAR)])
    with BagReader(drive) as reader, BagWriter(tmp_path / "moving.mcap") as writer:
        writer.write("/tf", message, START_NS - 200_000_000)
        for recorded in reader.messages():
            writer.copy(recorded)
    assert replay(tmp_path / "moving.mcap", tmp_path / "out.mcap", estimator).without_radar == 0


def test_passthrough_keeps_the_inputs(tmp_path: Path, write_drive: WriteDrive, estimator: Estimator) -> None:
    drive = write_drive(tmp_path / "drive", frames=2)
    replay(
        drive,
        tmp_path / "out",
        estimator,
        options=ReplayOptions(passthrough=True, output=OutputConfig(depth_encoding="16UC1")),
    )
    with BagReader(tmp_path / "out") as reader:
        counts = {topic.name: topic.count for topic in reader.topics}
    assert counts["/camera/image_raw"] == counts["/ground_truth/depth"] == counts["/depth/image_rect"] == 2


@pytest.mark.parametrize(
    ("without", "message"),
    [
        (("/camera/image_raw",), "image"),
        (("/camera/camera_info",), "camera_info"),
        (("/radar/points",), "radar"),
        (("/tf_static",), "nothing came on /tf_static"),
    ],
)
def test_a_bag_that_lacks_something_leaves_nothing_behind(
    tmp_path: Path, write_drive: WriteDrive, estimator: Estimator, without: tuple[str, ...], message: str
) -> None:
    drive = write_drive(tmp_path / "drive.mcap", without=without)
    with pytest.raises(RadcamDepthError, match=message):
        replay(drive, tmp_path / "out.mcap", estimator)
    assert [path.name for path in tmp_path.iterdir()] == ["drive.mcap"]


def test_a_truncated_bag_leaves_nothing_behind(tmp_path: Path, write_drive: WriteDrive, estimator: Estimator) -> None:
    drive = write_drive(tmp_path / "drive.mcap")
    drive.write_bytes(drive.read_bytes()[:20_000])
    with pytest.raises(BagError):
        replay(drive, tmp_path / "out.mcap", estimator)
    with pytest.raises(BagError, match="missing"):
        replay(tmp_path / "missing.mcap", tmp_path / "out.mcap", estimator)
    assert [path.name for path in tmp_path.iterdir()] == ["drive.mcap"]


@pytest.mark.parametrize("error", [EstimatorError("the network gave nonsense"), KeyboardInterrupt()])
def test_a_replay_that_ends_early_leaves_nothing_behind(
    tmp_path: Path,
    write_drive: WriteDrive,
    estimator: Estimator,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
) -> None:
    drive = write_drive(tmp_path / "drive.mcap")
    run, seen = estimator.run, []

    def run_three(inputs: NetworkInputs) -> object:
        if inputs.frame.stamp_ns == START_NS + 3 * PERIOD_NS:
            raise error
        return run(inputs)

    monkeypatch.setattr(estimator, "run", run_three)
    with pytest.raises(type(error)):
        replay(drive, tmp_path / "out.mcap", estimator, progress=lambda done, _: seen.append(done))
    assert seen == [1, 2, 3]  # in order, up to the frame that failed
    assert [path.name for path in tmp_path.iterdir()] == ["drive.mcap"]


def test_frames_before_a_bad_message_are_done_first(
    tmp_path: Path, write_drive: WriteDrive, estimator: Estimator, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = write_drive(tmp_path / "drive.mcap")
    accept, seen = Pipeline.build, []

    def refuse_the_last(self: Pipeline, topic: str, message: object, now_ns: int) -> tuple[Frame, ...]:
        if now_ns >= START_NS + 4 * PERIOD_NS:
            raise MessageError("the image is truncated")
        return accept(self, topic, message, now_ns)

    monkeypatch.setattr(Pipeline, "build", refuse_the_last)
    with pytest.raises(MessageError, match=r"/camera/\w+, 3 frames into the bag: the image is truncated"):
        replay(drive, tmp_path / "out.mcap", estimator, progress=lambda done, _: seen.append(done))
    assert seen == [1, 2, 3]
    assert [path.name for path in tmp_path.iterdir()] == ["drive.mcap"]


def test_compressed_output_holds_the_same(tmp_path: Path, write_drive: WriteDrive, estimator: Estimator) -> None:
    drive = write_drive(tmp_path / "drive.mcap")
    for name, compress in (("a.mcap", False), ("b.mcap", True)):
        replay(drive, tmp_path / name, estimator, options=ReplayOptions(compress=compress))
    assert (tmp_path / "b.mcap").stat().st_size < (tmp_path / "a.mcap").stat().st_size
    first, second = depths(tmp_path / "a.mcap"), depths(tmp_path / "b.mcap")
    for stamp, depth in first.items():
        np.testing.assert_array_equal(depth, second[stamp])


def test_samples_have_exact_depth(tmp_path: Path, write_drive: WriteDrive) -> None:
    samples = list(read_samples(write_drive(tmp_path / "drive.mcap")))
    assert len(samples) == 5
    for index, sample in enumerate(samples):
        assert sample.source == "exact"
        assert sample.radars == ("/radar/points",)
        assert len(sample.radar_parts[0]) == 4
        assert np.isinf(sample.depth_m[:8]).all()
        assert (sample.depth_m[8:] == 10.0 + index).all()


def test_samples_without_ground_truth(tmp_path: Path, write_drive: WriteDrive) -> None:
    drive = write_drive(tmp_path / "drive.mcap", without=("/ground_truth/depth",))
    samples = list(read_samples(drive))
    assert {sample.source for sample in samples} == {"none"}
    assert np.isnan(samples[0].depth_m).all()
    with pytest.raises(DriveError, match="ground_truth 'exact' needs a topic"):
        list(read_samples(drive, DriveSettings(ground_truth="exact")))
    with pytest.raises(DriveError, match="ground_truth must be one of"):
        DriveSettings(ground_truth="guess")


def test_extrinsics_given_by_hand(tmp_path: Path, write_drive: WriteDrive, estimator: Estimator) -> None:
    drive = write_drive(tmp_path / "drive.mcap", without=("/tf_static",))
    numbers = (*CAMERA_FROM_RADAR.translation, *CAMERA_FROM_RADAR.quaternion)
    summary = replay(drive, tmp_path / "out", estimator, DriveSettings(FrameBuilderConfig(camera_from_radar=numbers)))
    assert summary.frames == 5


def test_several_sweeps_of_a_bag_that_does_not_say_how_the_vehicle_moved(
    tmp_path: Path, write_drive: WriteDrive, estimator: Estimator
) -> None:
    drive = write_drive(tmp_path / "drive.mcap")
    settings = DriveSettings(FrameBuilderConfig(pairing=PairingConfig(radar_sweeps=3)))
    sentence = r"in 5 of 5 frames radar returns cannot be moved .* no pose of 'camera' in 'odom' came on /tf"
    with pytest.warns(DriveWarning, match=sentence):
        summary = replay(drive, tmp_path / "out", estimator, settings)
    assert (summary.frames, summary.without_radar) == (5, 0)
    with pytest.warns(DriveWarning, match=sentence):
        samples = list(read_samples(drive, settings))
    assert [len(sample.frame.radar) for sample in samples] == [4] * 5


def test_a_real_drive(astyx_val: Path, estimator: Estimator) -> None:
    samples = list(read_samples(astyx_val))
    assert len(samples) == 16
    for sample in samples:
        assert sample.source == "lidar"
        assert 500 < np.isfinite(sample.depth_m).sum() < 5000
        assert len(sample.frame.radar) > 500
        assert sample.frame.camera != CAMERA
    assert np.isfinite(estimator.estimate(samples[-1].frame).dense).all()


def test_a_radar_without_stamps_is_read_by_arrival(tmp_path: Path, estimator: Estimator) -> None:
    drive = write_changed(tmp_path / "drive.mcap", without_radar_stamps, frames=4)
    with pytest.warns(DriveWarning, match="set radar_stamps: arrival"):
        replay(drive, tmp_path / "lost.mcap", estimator)
    settings = DriveSettings(FrameBuilderConfig(radar_stamps="arrival"))
    summary = replay(drive, tmp_path / "found.mcap", estimator, settings)
    assert (summary.frames, summary.without_radar) == (4, 0)


def test_an_intensity_that_is_likely_doppler_is_warned_of(tmp_path: Path, estimator: Estimator) -> None:
    drive = write_changed(tmp_path / "drive.mcap", doppler_as_intensity())
    sentence = "set the parameter radar_fields to radial_speed=intensity rcs="
    with pytest.warns(DriveWarning, match=sentence):
        replay(drive, tmp_path / "out.mcap", estimator)
    told: list[str] = []
    assert len(list(read_samples(drive, warn=told.append))) == 12
    assert [sentence in text for text in told] == [True]
