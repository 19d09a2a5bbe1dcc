from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks import contact_sheet
from radcam_depth_ros.frame import ImageArray


def noise(roughness: float, seed: int = 0) -> ImageArray:
    """A grey picture (240, 320, 3) whose amplitude falls with frequency to a power."""
    spectrum = np.fft.rfft2(np.random.default_rng(seed).standard_normal((480, 640)))
    frequency = np.hypot(np.fft.fftfreq(480)[:, None], np.fft.rfftfreq(640)[None])
    plane = np.fft.irfft2(spectrum * np.maximum(frequency, 1 / 640) ** -roughness)
    grey = np.clip(127 + 40 * plane / plane.std(), 0, 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


@pytest.mark.parametrize("roughness", [0.0, 1.0])
def test_the_slope_of_a_known_spectrum_is_found(roughness: float) -> None:
    assert contact_sheet.measures(noise(roughness))["spectrum's slope"] == pytest.approx(-2 * roughness, abs=0.2)


def test_statistics_tell_pictures_apart() -> None:
    plain = contact_sheet.measures(np.full((120, 160, 3), 128, np.uint8))
    red = contact_sheet.measures(np.full((120, 160, 3), (200, 40, 40), np.uint8))
    assert plain["edge density"] == plain["saturation"] == 0
    assert red["saturation"] == pytest.approx(0.8)
    assert red["cast"] > 50 > 1 > plain["cast"]
    assert contact_sheet.measures(noise(0.5))["edge density"] > 0.1


def test_a_summary_has_percentiles_and_the_sheet_is_written(tmp_path: Path) -> None:
    images = [noise(1.0, seed) for seed in range(3)]
    row = contact_sheet.summary(images)
    assert row["pictures"] == 3
    low, middle, high = row["brightness"]
    assert 0 < low <= middle <= high < 1
    assert sum(row["histogram"]) == pytest.approx(1.0)
    contact_sheet.draw(images, {"simulated": row}, tmp_path / "sheet.png")
    assert cv2.imread(str(tmp_path / "sheet.png")) is not None
    assert contact_sheet.table_of({"simulated": row}).row_count == len(contact_sheet.measures(images[0]))
