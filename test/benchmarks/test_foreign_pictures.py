from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from small_drive import CAMERA, small_image

from benchmarks import foreign_pictures
from benchmarks.foreign_pictures import ANOTHER, CHANGES, NATIVE, ROWS, changed, measure
from radcam_depth_ros.drive import DriveSettings, read_samples
from radcam_depth_ros.evaluation.measures.errors import EvaluationError
from radcam_depth_ros.frame import DepthResult, Frame

Write = Callable[..., Path]


def by_picture(frame: Frame) -> DepthResult:
    """Depth of the first frame's truth, 10 m; 30 m and no doubt where the picture is black, 12 m without returns."""
    shape = (CAMERA.height, CAMERA.width)
    depth_m = 30.0 if not frame.image.any() else 10.0 if len(frame.radar) else 12.0
    dense, confidence = np.full(shape, depth_m, np.float32), np.ones(shape, np.float32)
    return DepthResult(frame.stamp_ns, "camera", CAMERA, dense, np.full_like(dense, np.nan), confidence, 1)


def frames_of(name: str, bags: list[Path], index: int = 0) -> list[Frame]:
    return [sample.frame for sample in changed(name, bags, index, None, DriveSettings())]


def test_a_black_picture_changes_nothing_else(write_drive: Write, tmp_path: Path) -> None:
    bag = write_drive(tmp_path / "drive", frames=3)
    kept = list(read_samples(bag))
    found = list(changed("black", [bag], 0, None, DriveSettings()))
    assert len(found) == len(kept) == 3
    for sample, original in zip(found, kept, strict=True):
        assert not sample.frame.image.any()
        assert original.frame.image.any()
        assert (sample.frame.stamp_ns, sample.frame.camera) == (original.frame.stamp_ns, original.frame.camera)
        # By their words: from Python 3.13 on a road of unknown height, NaN, equals no other.
        assert repr((sample.frame.ground, sample.frame.lens)) == repr((original.frame.ground, original.frame.lens))
        np.testing.assert_array_equal(sample.frame.radar.xyz_m, original.frame.radar.xyz_m)
        np.testing.assert_array_equal(sample.frame.radar.rcs_dbsm, original.frame.radar.rcs_dbsm)
        np.testing.assert_array_equal(sample.depth_m, original.depth_m)


def test_noise_and_blur_change_the_picture_alone(write_drive: Write, tmp_path: Path) -> None:
    frame = next(iter(read_samples(write_drive(tmp_path / "drive")))).frame
    noise, again, blurred = (CHANGES[name](frame) for name in ("noise", "noise", "blurred"))
    np.testing.assert_array_equal(noise.image, again.image)
    assert (noise.image != frame.image).mean() > 0.9
    assert blurred.image.std() < 0.5 * frame.image.std()
    assert noise.radar is blurred.radar is frame.radar


def test_the_radar_is_withheld(write_drive: Write, tmp_path: Path) -> None:
    bag = write_drive(tmp_path / "drive", frames=2)
    assert [len(frame.radar) for frame in frames_of("radar withheld", [bag])] == [0, 0]
    assert all(frame.image.any() for frame in frames_of("radar withheld", [bag]))


def test_pictures_of_another_drive(write_drive: Write, tmp_path: Path) -> None:
    bags = [write_drive(tmp_path / "a", frames=5), write_drive(tmp_path / "b", frames=2)]
    shown = frames_of(ANOTHER, bags)
    # The next bag has two pictures, which come again.
    for frame, index in zip(shown, (0, 1, 0, 1, 0), strict=True):
        np.testing.assert_array_equal(frame.image, small_image(index))
    # A single bag shows its own pictures of half a drive later.
    for frame, index in zip(frames_of(ANOTHER, bags[:1]), (2, 3, 4, 0, 1), strict=True):
        np.testing.assert_array_equal(frame.image, small_image(index))


def test_pictures_of_another_size_are_resized(write_drive: Write, tmp_path: Path) -> None:
    frame = next(iter(read_samples(write_drive(tmp_path / "drive")))).frame
    assert foreign_pictures.replaced(frame, np.full((32, 32, 3), 7, np.uint8)).image.shape == frame.image.shape


def test_a_single_picture_cannot_be_replaced_by_another(write_drive: Write, tmp_path: Path) -> None:
    bag = write_drive(tmp_path / "drive", frames=1)
    with pytest.raises(EvaluationError, match="add a bag"):
        frames_of(ANOTHER, [bag])


def test_each_row_is_measured(write_drive: Write, tmp_path: Path) -> None:
    bags = [write_drive(tmp_path / name, frames=3) for name in ("a", "b")]
    done: list[None] = []
    rows = measure(bags, by_picture, 1, advance=lambda: done.append(None))
    assert tuple(rows) == ROWS
    assert len(done) == 2 * len(ROWS)
    assert rows[NATIVE]["frames"] == 2
    assert [rows[name]["mae_80"] for name in (NATIVE, "black", "radar withheld")] == pytest.approx([0.0, 20.0, 2.0])
    assert (rows[NATIVE]["ece"], rows["black"]["ece"]) == (0.0, 1.0)
    assert (rows[NATIVE]["worse_frames_share_80"], rows["black"]["worse_frames_share_80"]) == (0.0, 1.0)
    # Geometry alone does not see the picture, but it needs the radar.
    assert len({rows[name]["geometry_mae_50"] for name in ROWS[:-1]}) == 1
    assert rows["radar withheld"]["geometry_mae_50"] != rows[NATIVE]["geometry_mae_50"]
    assert all(row["largest_fall"] == 0.0 for row in rows.values())


def test_bags_without_truth_are_refused(write_drive: Write, tmp_path: Path) -> None:
    bag = write_drive(tmp_path / "drive", without=("/ground_truth/depth",))
    with pytest.raises(EvaluationError, match="ground truth"):
        measure([bag], by_picture)


def test_the_command_prints_a_table_and_json(
    write_drive: Write,
    tmp_path: Path,
    small_weights: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    bag = write_drive(tmp_path / "drive", frames=2)
    arguments = ["foreign_pictures", "--bags", str(bag), "--model", str(small_weights), "--limit", "2", "--json", "-"]
    monkeypatch.setattr(sys, "argv", arguments)
    foreign_pictures.main()
    printed = capsys.readouterr()
    values = json.loads(printed.out)
    assert list(values["pictures"]) == list(ROWS)
    assert {"mae_50", "mae_80", "geometry_mae_80", "worse_frames_share_80", "ece", "largest_fall"} <= set(
        values["pictures"]["black"]
    )
    assert values["bags"] == [str(bag)]
    assert "black" in printed.err
