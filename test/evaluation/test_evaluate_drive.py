from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

from radcam_depth_ros.classes import CLASS_NAMES
from radcam_depth_ros.drive import Sample, ScanUse
from radcam_depth_ros.evaluation.drive import Drive, EvaluationSettings, evaluate_drive, evaluate_drives, resize_result
from radcam_depth_ros.evaluation.measures.errors import EvaluationError
from radcam_depth_ros.evaluation.measures.metrics import MEASURES
from radcam_depth_ros.evaluation.plots import plots_of
from radcam_depth_ros.evaluation.summary import Latency
from radcam_depth_ros.evaluation.tables import facts_of, tables_of
from radcam_depth_ros.frame import ASSUMED_HEIGHT_M, CameraModel, DepthResult, Frame, GroundPlane, RadarReturns
from radcam_depth_ros.reporting.plot import draw_plot

CAMERA = CameraModel(64, 48, 50.0, 50.0, 31.5, 23.5)


def make_sample(depth_m=20.0, stamp_ns=0, ground=None, classes=None, source="exact"):
    shape = (CAMERA.height, CAMERA.width)
    image = np.zeros((*shape, 3), np.uint8)
    radar = RadarReturns.from_points([(0.0, 0.0, 15.0)])
    frame = Frame(stamp_ns, "camera", image, CAMERA, radar, ground or GroundPlane())
    return Sample(frame, ("/radar",), np.full(shape, depth_m, np.float32), source, classes)


def result_of(frame, dense_m=21.0, semi_dense_m=22.0, camera=CAMERA):
    shape = (camera.height, camera.width)
    semi_dense = np.full(shape, np.nan, np.float32)
    semi_dense[: camera.height // 4] = semi_dense_m
    dense = np.full(shape, dense_m, np.float32)
    return DepthResult(frame.stamp_ns, "camera", camera, dense, semi_dense, np.ones(shape, np.float32), 1)


def test_a_drive_is_measured():
    evaluation = evaluate_drive([make_sample(20.0), make_sample(60.0)], result_of, EvaluationSettings("stub"))
    assert (evaluation.network, evaluation.frames, evaluation.frames_missing) == ("stub", 2, 0)
    assert evaluation.ground_truth == "exact"
    assert evaluation.has_ground_truth
    assert evaluation.dense.within(50).mae == pytest.approx(1.0)
    assert evaluation.dense.within(70).mae == pytest.approx((1.0 + 39.0) / 2)
    assert [entry.frames for entry in evaluation.dense.bins] == [0, 1, 0, 1]
    assert evaluation.semi_dense.coverage == pytest.approx(0.25)
    assert evaluation.semi_dense.metrics[0].mae == pytest.approx(2.0)
    assert evaluation.baselines["ground_nearest"].within(50).frames == 1
    with pytest.raises(EvaluationError, match="50, 70, 80 m, got 60 m"):
        evaluation.dense.within(60)


def test_how_lidar_scans_were_used_is_told():
    uses = [ScanUse("as_it_lies", 0.02), ScanUse("moved", 0.04, 0.5), ScanUse("left_out", 0.01, reason="no pose")]
    samples = [dataclasses.replace(make_sample(source="lidar"), scan=use) for use in uses]
    evaluation = evaluate_drive(samples, result_of)
    plain = json.loads(json.dumps(evaluation.as_json(), allow_nan=False))["lidar_scans"]
    assert {name: group["scans"] for name, group in plain.items()} == {"moved": 1, "as_they_lie": 1, "left_out": 1}
    assert plain["moved"]["mean_offset_ms"] == pytest.approx(40)
    assert plain["moved"]["mean_shift_m"] == pytest.approx(0.5)
    assert plain["left_out"]["reason"] == "no pose"
    (fact,) = [fact.value for fact in facts_of(evaluation) if fact.name == "LiDAR scans"]
    for words in ("1 moved", "1 taken as they lie", "0.20 m at 10 m/s", "1 left out", "no pose"):
        assert words in fact
    exact = evaluate_drive([make_sample()], result_of)
    assert exact.as_json()["lidar_scans"] is None
    assert not [fact for fact in facts_of(exact) if fact.name == "LiDAR scans"]


def test_the_json_has_what_is_promised():
    plain = json.loads(json.dumps(evaluate_drive([make_sample()], result_of).as_json(), allow_nan=False))
    for group in (plain["dense"], plain["baselines"]["ground_nearest"], plain["semi_dense"]):
        for name in ("50", "70", "80"):
            assert set(MEASURES) <= set(group[name])
            assert all(isinstance(group[name][key], float) for key in MEASURES)
    assert set(plain["by_range"]) == {"0-10", "10-30", "30-50", "50-100"}
    assert plain["by_range"]["30-50"]["mae"] is None
    assert (plain["semi_dense"]["coverage"], plain["semi_dense"]["mae"]) == pytest.approx((0.25, 2.0))
    assert plain["frames"] == 1
    assert plain["network"] == "network"
    assert plain["latency_ms"]["p99"] >= plain["latency_ms"]["p50"] > 0


def test_a_frame_without_depth_is_counted_and_left_out():
    samples = [make_sample(20.0, stamp_ns) for stamp_ns in range(3)]
    evaluation = evaluate_drive(samples, lambda frame: None if frame.stamp_ns == 1 else result_of(frame))
    assert (evaluation.frames, evaluation.frames_missing) == (3, 1)
    assert evaluation.dense.within(80).frames == 2
    assert evaluation.baselines["ground_nearest"].within(80).frames == 2
    assert any(fact.name == "frames without depth" and fact.value == "1" for fact in facts_of(evaluation))


def test_a_drive_without_ground_truth_gives_no_numbers():
    evaluation = evaluate_drive([make_sample(math.nan, source="none")], result_of)
    assert not evaluation.has_ground_truth
    assert evaluation.semi_dense.image_share == pytest.approx(0.25)
    assert evaluation.as_json()["semi_dense"]["coverage"] is None
    assert evaluation.as_json()["dense"]["80"]["mae"] is None
    assert all("nan" not in cell for table in tables_of(evaluation) for row in table.rows for cell in row)


def test_a_drive_without_frames_is_refused():
    with pytest.raises(EvaluationError, match="at least one image"):
        evaluate_drive([], result_of)


@pytest.mark.parametrize(
    ("ground", "given_m", "height_m", "source"),
    [
        (GroundPlane(1.9), None, 1.9, "frame"),
        (GroundPlane(1.9), 1.9, 1.9, "given"),
        (GroundPlane(), 2.1, 2.1, "given"),
        (GroundPlane(), None, ASSUMED_HEIGHT_M, "assumed"),
    ],
)
def test_where_the_camera_s_height_comes_from_is_said(ground, given_m, height_m, source):
    settings = EvaluationSettings(camera_height_m=given_m)
    evaluation = evaluate_drive([make_sample(ground=ground)], result_of, settings)
    assert (evaluation.given.camera_height_m, evaluation.given.camera_height_source) == (height_m, source)
    baseline = evaluation.as_json()["baselines"]["ground_nearest"]
    assert (baseline["camera_height_m"], baseline["camera_height_source"]) == (height_m, source)


def test_classes_are_measured_apart():
    classes = np.zeros((48, 64), np.uint8)
    classes[:10] = 10
    classes[10:20] = 13
    classes[20:22] = 255
    sample = make_sample(20.0, classes=classes)
    sample.depth_m[:10] = np.inf
    sample.depth_m[10:20] = 25.0
    evaluation = evaluate_drive([sample], result_of)
    assert {entry.name: entry.mae for entry in evaluation.by_class} == pytest.approx({"road": 1.0, "car": 4.0})
    assert {entry.name: entry.mae for entry in evaluation.by_class_group} == pytest.approx(
        {"road, people and vehicles": 1.0 + 3.0 * (10 * 64) / (36 * 64)}
    )
    titles = [table.title for table in tables_of(evaluation)]
    assert titles[-3:-1] == ["By class, within 80 m", "By group of classes, within 80 m"]
    assert titles[-1].startswith("Error of small things by distance")
    car = evaluation.as_json()["things"]["car"]
    assert list(evaluation.as_json()["things"]) == ["car"]
    assert car["80"] == car["20-30"] == pytest.approx({"mae": 4.0, "median": 4.0, "pixels": 10 * 64}, rel=0.005)
    assert tables_of(evaluation)[-1].rows[2] == ("car, pixels", "640", "0", "0", "640", "0", "0")


def stepped_sample(source="exact"):
    """A pole of another depth in the middle of the image, before a wall; sky above."""
    classes = np.full((48, 64), CLASS_NAMES.index("building"), np.uint8)
    classes[:, 30:34] = CLASS_NAMES.index("pole")
    sample = make_sample(20.0, classes=classes, source=source)
    sample.depth_m[:, 30:34] = 12.0
    sample.depth_m[:5] = np.inf
    return sample


def test_edges_of_exact_depth_are_measured_apart():
    evaluation = evaluate_drive([stepped_sample()], result_of)
    plain = json.loads(json.dumps(evaluation.as_json(), allow_nan=False))["edges"]
    rows = {row[0]: row for row in tables_of(evaluation)[0].rows}
    assert plain["away"]["80"]["mae"] == pytest.approx(1.0)
    assert plain["80"]["mae"] > plain["50"]["frames"] == 1
    assert 0 < plain["share"] < 1
    assert rows["dense, near edges"][1] == f"{plain['50']['mae']:.2f}"
    assert rows["dense, away from edges"][1] == "1.00"
    assert f"{100 * plain['share']:.1f} % of the pixels within 80 m" in tables_of(evaluation)[0].note
    details = next(table for table in tables_of(evaluation) if table.title == "All measures")
    assert "dense, near edges, 70 m" in {row[0] for row in details.rows}


@pytest.mark.parametrize("source", ["lidar", "none"])
def test_without_exact_depth_there_are_no_edges(source):
    evaluation = evaluate_drive([stepped_sample(source)], result_of)
    assert evaluation.as_json()["edges"] is None
    assert not [row[0] for table in tables_of(evaluation) for row in table.rows if "edges" in row[0]]
    assert all("edges" not in table.note for table in tables_of(evaluation))


def test_drives_apart_and_together_have_the_same_edges_and_things():
    samples = [stepped_sample(), make_sample(25.0), stepped_sample()]
    depths_m = {0: 21.0, 1: 30.0, 2: 15.0}
    samples = [
        dataclasses.replace(sample, frame=dataclasses.replace(sample.frame, stamp_ns=stamp_ns))
        for stamp_ns, sample in enumerate(samples)
    ]

    def estimate(frame):
        return result_of(frame, depths_m[frame.stamp_ns])

    whole = evaluate_drives([Drive(samples, "a")], estimate).as_json()
    parts = evaluate_drives([Drive(samples[:1], "a"), Drive(samples[1:], "b")], estimate).as_json()
    assert whole["edges"] == parts["edges"]
    assert whole["things"] == parts["things"]
    assert whole["things"]["pole"]["80"]["pixels"] == 2 * 43 * 4


def test_predictions_may_be_clipped_elsewhere():
    def far(frame):
        return result_of(frame, 90.0)

    assert evaluate_drive([make_sample()], far).dense.within(50).mae == pytest.approx(30.0)
    evaluation = evaluate_drive([make_sample()], far, EvaluationSettings(clip_m=80.0))
    assert evaluation.dense.within(50).mae == pytest.approx(60.0)
    assert evaluation.as_json()["clip_m"] == 80.0


@pytest.mark.parametrize("setting", [{"clip_m": 0.0}, {"camera_height_m": math.nan}, {"camera_height_m": -1.0}])
def test_impossible_settings_are_refused(setting):
    with pytest.raises(EvaluationError, match="positive number of metres"):
        EvaluationSettings(**setting)


def test_all_frames_of_all_drives_count_alike():
    drives = [
        Drive([make_sample(20.0), make_sample(22.0)], "a", {"weather": "rain", "mood": "good"}),
        Drive(iter([make_sample(25.0)]), "b", {"weather": "dry"}),
    ]
    seen = []
    evaluation = evaluate_drives(drives, result_of, observe=seen.append)
    assert evaluation.frames == 3
    assert evaluation.dense.within(80).mae == pytest.approx((1.0 + 1.0 + 4.0) / 3)
    assert [(observation.drive.name, observation.index) for observation in seen] == [("a", 0), ("a", 1), ("b", 0)]
    plain = json.loads(json.dumps(evaluation.as_json(), allow_nan=False))
    assert {name: plain["by_bag"][name]["mae"] for name in ("a", "b")} == pytest.approx({"a": 1.0, "b": 4.0})
    assert plain["by_weather"]["rain"]["frames"] == 2
    assert plain["by_weather"]["dry"]["baselines"]["ground_nearest"]["frames"] == 1
    assert list(plain["by_returns"]) == ["1-10"]
    assert "by_mood" not in plain
    titles = [table.title for table in tables_of(evaluation)]
    assert titles[-2:] == ["By weather, within 80 m", "By bag, within 80 m"]


def test_baselines_are_measured_on_the_same_frames():
    def by_radar(frame):
        return result_of(frame, 21.0 if len(frame.radar) else 26.0)

    settings = EvaluationSettings(baselines=("ground_nearest", "camera_only", "radar_interpolation"))
    seen = []
    evaluation = evaluate_drive([make_sample(20.0)], by_radar, settings, seen.append)
    assert evaluation.dense.within(80).mae == pytest.approx(1.0)
    assert evaluation.baselines["camera_only"].within(80).mae == pytest.approx(6.0)
    # The one return is at 15 m.
    assert evaluation.baselines["radar_interpolation"].within(80).mae == pytest.approx(5.0, rel=1e-4)
    assert set(evaluation.as_json()["baselines"]) == set(settings.baselines) == set(seen[0].baselines)
    rows = {row[0]: row[3] for row in tables_of(evaluation)[0].rows}
    assert (rows["camera alone"], rows["radar alone"]) == ("6.00", "5.00")
    note = tables_of(evaluation)[0].note
    assert "the same network without any radar return" in note


def test_depth_that_is_read_cannot_be_without_radar():
    def recorded(frame):
        return result_of(frame) if len(frame.radar) else None

    with pytest.raises(EvaluationError, match="leave it out where depth is not estimated"):
        evaluate_drive([make_sample()], recorded, EvaluationSettings(baselines=("camera_only",)))


def test_unknown_baselines_are_refused():
    with pytest.raises(EvaluationError, match=r"one of ground_nearest, .* got 'magic'"):
        EvaluationSettings(baselines=("magic",))


def test_what_the_network_was_given_is_said():
    told = {fact.name: fact.value for fact in facts_of(evaluate_drive([make_sample()], result_of))}
    assert "64 x 48 px" in told["the network was given"]
    assert "1 to 1 radar returns in view" in told["the network was given"]
    assert "camera's height above it is unknown" in told["the network was given"]
    known = evaluate_drive([make_sample(ground=GroundPlane(1.5)), make_sample()], result_of)
    assert (
        "the road in 50 % of the frames" in {fact.name: fact.value for fact in facts_of(known)}["the network was given"]
    )


def test_the_confidence_is_measured():
    evaluation = evaluate_drive([make_sample(20.0)], result_of)
    assert evaluation.sparsification.frames == 1
    assert evaluation.sparsification.mae.ause_m == pytest.approx(0.0, abs=1e-6)
    assert any(fact.name == "confidence" and "AUSE 0.00 m" in fact.value for fact in facts_of(evaluation))
    assert [plot.title for plot in plots_of(evaluation)] == [
        *("Error over distance", "Sparsification, MAE", "Sparsification, RMSE"),
        "Reliability of the confidence",
    ]


def test_whoever_looks_on_sees_every_frame():
    seen = []
    evaluate_drive([make_sample(20.0, 5), make_sample(30.0, 6)], result_of, observe=seen.append)
    assert [observation.index for observation in seen] == [0, 1]
    assert [observation.sample.frame.stamp_ns for observation in seen] == [5, 6]
    assert [observation.mae_m for observation in seen] == pytest.approx([1.0, 9.0])
    assert seen[0].baselines["ground_nearest"].shape == (48, 64)


@pytest.mark.parametrize("size", [(32, 24), (128, 96), (64, 47)])
def test_depth_of_another_size_is_brought_to_the_truth_s(size):
    camera = CameraModel(*size, 25.0, 25.0, 15.5, 11.5)
    sample = make_sample(20.0)
    result = resize_result(result_of(sample.frame, 21.0, 22.0, camera), sample.frame)
    assert result.camera == CAMERA
    assert (result.dense == np.float32(21.0)).all()
    assert set(np.unique(result.semi_dense[np.isfinite(result.semi_dense)])) == {22.0}
    assert np.isfinite(result.semi_dense).mean() == pytest.approx(0.25, abs=0.03)
    evaluation = evaluate_drive([sample], lambda frame: result_of(frame, camera=camera))
    assert evaluation.dense.within(80).mae == pytest.approx(1.0)


def test_depth_of_another_shape_is_refused():
    sample = make_sample()
    camera = CameraModel(64, 96, 50.0, 50.0, 31.5, 47.5)
    with pytest.raises(EvaluationError, match=r"64 x 48 image .* got 64 x 96"):
        evaluate_drive([sample], lambda frame: result_of(frame, camera=camera))


def test_latency_leaves_the_first_frame_out():
    assert Latency.of([9.0, 0.1, 0.1]).p99_ms == pytest.approx(100.0)
    assert Latency.of([0.2]).p50_ms == pytest.approx(200.0)
    assert math.isnan(Latency.of([]).p50_ms)


def test_tables_say_what_was_measured():
    evaluation = evaluate_drive([make_sample(20.0), make_sample(60.0)], result_of)
    summary = tables_of(evaluation)[0]
    assert summary.columns == ("", "MAE 50", "MAE 70", "MAE 80", "RMSE 50", "RMSE 70", "RMSE 80")
    dense = ("dense", "dense, near edges", "dense, away from edges")
    assert [row[0] for row in summary.rows] == [*dense, "semi-dense", "geometry alone"]
    assert summary.rows[0][1:4] == ("1.00", "20.00", "20.00")
    facts = {fact.name: fact.value for fact in facts_of(evaluation)}
    assert facts["semi-dense coverage"] == "25.0 % of the pixels within 80 m"
    assert "assumed" in facts["camera above the road, for geometry alone"]


def test_an_evaluation_is_a_value():
    evaluation = evaluate_drive([make_sample()], result_of)
    with pytest.raises(dataclasses.FrozenInstanceError):
        evaluation.frames = 2


def test_infinite_depth_counts_as_the_farthest():
    def partly_infinite(frame):
        result = result_of(frame, 21.0)
        result.dense[:12] = np.inf
        return result

    evaluation = evaluate_drive([make_sample(20.0)], partly_infinite)
    for range_m in (50, 70, 80):
        assert evaluation.dense.within(range_m).mae == pytest.approx(0.75 * 1.0 + 0.25 * (range_m - 20.0))
    # By distance, depth is clipped to 100 m.
    assert evaluation.dense.bins[1].mae == pytest.approx(0.75 * 1.0 + 0.25 * 80.0)
    assert evaluation.dense.coverage == pytest.approx((0.75, 0.75, 0.75))
    plain = json.loads(json.dumps(evaluation.as_json(), allow_nan=False))
    assert [plain["dense"][name]["coverage"] for name in ("50", "70", "80")] == [0.75] * 3
    assert plain["baselines"]["ground_nearest"]["80"]["coverage"] == 1.0
    assert {fact.name: fact.value for fact in facts_of(evaluation)}["dense coverage"].startswith("75.0 %")
    table = next(table for table in tables_of(evaluation) if table.title == "All measures")
    shares = {row[0]: row[table.columns.index("coverage %")] for row in table.rows}
    assert (shares["dense, 80 m"], shares["semi-dense, 80 m"], shares["semi-dense, 50 m"]) == ("75.0", "25.0", "-")


def test_coverage_is_of_the_pixels_in_each_range():
    sample = make_sample(20.0)
    sample.depth_m[:24], sample.depth_m[24:36] = 60.0, math.nan

    def infinite_above(frame):
        result = result_of(frame, 21.0)
        result.dense[:12] = np.inf
        return result

    nothing = make_sample(math.nan)
    evaluation = evaluate_drive([sample, nothing], infinite_above)
    assert evaluation.dense.coverage == pytest.approx((1.0, 2 / 3, 2 / 3))
    assert evaluate_drive([nothing], infinite_above).as_json()["dense"]["80"]["coverage"] is None


def test_nan_in_the_dense_depth_is_refused():
    def with_holes(frame):
        result = result_of(frame)
        result.dense[0, :3] = np.nan
        return result

    drive = Drive([make_sample(20.0, stamp_ns=1_500_000_000)], "evening")
    with pytest.raises(EvaluationError, match=r"evening, got NaN in 3 pixels at stamp 1\.5"):
        evaluate_drives([drive], with_holes)

    def holes_without_radar(frame):
        return result_of(frame) if len(frame.radar) else with_holes(frame)

    with pytest.raises(EvaluationError, match="NaN in 3 pixels"):
        evaluate_drives([drive], holes_without_radar, EvaluationSettings(baselines=("camera_only",)))


def test_frames_worse_than_geometry_alone_are_told():
    # Geometry alone gives the return at 15 m or a nearer road: with truth at 15 m its error is that of the road.
    drives = [Drive([make_sample(15.0)] * 2, "good"), Drive([make_sample(15.0)], "bad")]
    depths_m = iter((15.1, 15.1, 70.0))
    evaluation = evaluate_drives(drives, lambda frame: result_of(frame, next(depths_m)))
    plain = json.loads(json.dumps(evaluation.as_json(), allow_nan=False))["worse_than_geometry"]
    for range_m in ("50", "80"):
        assert plain[range_m]["frames_share"] == pytest.approx(1 / 3)
        assert plain[range_m]["drives"] == ["bad"]
        assert plain[range_m]["frames_share_by_drive"] == {"good": 0.0, "bad": 1.0}
    told = {fact.name: fact.value for fact in facts_of(evaluation)}["worse than geometry alone"]
    assert "33.3 % of the frames within 80 m" in told
    assert "1 of 2 drives: bad (within 50 and 80 m; 100 %" in told
    (table,) = (table for table in tables_of(evaluation) if table.title.startswith("By bag"))
    place = table.columns.index("worse than geometry alone")
    assert [row[place:] for row in table.rows] == [("-", "0", "0"), ("50 and 80 m", "100", "100")]


def test_geometry_alone_is_compared_only_where_it_was_measured():
    drives = [Drive([make_sample()], "a"), Drive([make_sample()], "b")]
    evaluation = evaluate_drives(drives, result_of, EvaluationSettings(baselines=("radar_interpolation",)))
    assert "worse_than_geometry" not in evaluation.as_json()
    assert "worse than geometry alone" not in {fact.name for fact in facts_of(evaluation)}
    assert all("worse than geometry alone" not in table.columns for table in tables_of(evaluation))


def test_the_calibration_of_the_confidence_is_in_the_report():
    classes = np.zeros((48, 64), np.uint8)
    classes[:24] = 13
    drives = [Drive([make_sample(20.0, classes=classes)], "a", {"time_of_day": "night"})]
    evaluation = evaluate_drives(drives, lambda frame: result_of(frame, 30.0))
    plain = json.loads(json.dumps(evaluation.as_json(), allow_nan=False))
    # A confidence of 1, and depth that is wrong everywhere.
    assert plain["confidence"]["ece"] == 1.0
    assert plain["confidence"]["by_time_of_day"]["night"]["ece"] == 1.0
    assert plain["confidence"]["by_surface"]["road"]["pixels"] == 24 * 64
    assert {fact.name: fact.value for fact in facts_of(evaluation)}["calibration of the confidence"] == (
        "ECE 1.000; the observed share never falls from one bin to the next"
    )
    tables = {table.title: table for table in tables_of(evaluation)}
    assert tables["Reliability of the confidence, within 80 m"].rows[-1] == ("0.9-1.0", "1.000", "0.000", "100.0")
    assert tables["Minimum confidence, within 80 m"].rows[-1] == ("0.9", "100.0", "0.0")
    parts = tables["Calibration of the confidence, within 80 m"].rows
    assert [row[0] for row in parts] == ["all", "night", "0-20 m", "20-50 m", "50-80 m", "road", "not road"]
    assert parts[3][1:] == ("-", "-", "0.0")
    plot = plots_of(evaluation)[-1]
    assert (plot.curves[0].x, plot.curves[0].y) == ([1.0], [0.0])
    assert draw_plot(plot).startswith(b"<?xml")


def test_depth_without_confidence_has_no_calibration():
    def unsure(frame):
        result = result_of(frame)
        result.confidence[:] = np.nan
        return result

    evaluation = evaluate_drive([make_sample()], unsure)
    assert evaluation.as_json()["confidence"]["ece"] is None
    assert not [table for table in tables_of(evaluation) if "confidence" in table.title]
    assert "calibration of the confidence" not in {fact.name for fact in facts_of(evaluation)}
    assert "Reliability of the confidence" not in {plot.title for plot in plots_of(evaluation)}
