from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.simulation.sensors.camera_unit import CameraUnit
from radcam_depth_ros.simulation.settings.looks import Looks

SEEDS = st.integers(0, 2**31)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_exposure_brings_any_light_into_the_picture(seed: int) -> None:
    rng = np.random.default_rng(seed)
    radiance = (rng.random((48, 64, 3)) * 10 ** rng.uniform(-3, 3)).astype(np.float32)
    picture = CameraUnit(rng, 64, 48).develop(radiance, rng)
    assert picture.shape == (48, 64, 3)
    assert 15 < picture.mean() < 250


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, rain=st.sampled_from([0.0, 1.0]), odd=st.booleans())
def test_any_lens_gives_a_picture(seed: int, rain: float, odd: bool) -> None:
    rng = np.random.default_rng(seed)
    radiance = rng.random((48, 80, 3)).astype(np.float32) * np.linspace(0.02, 2, 80, dtype=np.float32)[:, None]
    radiance[10, 10] = 300.0
    picture = CameraUnit(rng, 80, 48, rain, odd).develop(radiance, rng, np.full((48, 80, 2), 200.0, np.float32))
    assert picture.shape == (48, 80, 3)
    assert picture.std() > 3


def test_white_balance_takes_most_of_the_colour_of_the_light() -> None:
    scene = np.random.default_rng(0).random((48, 64, 1)).astype(np.float32) * np.array([0.5, 0.8, 1.6], np.float32)

    def cast(follows: bool) -> float:
        casts = []
        for seed in range(12):
            unit = CameraUnit(np.random.default_rng(seed), 64, 48, looks=Looks(white_balance=follows))
            red, _, blue = unit.develop(scene, np.random.default_rng(1)).mean(axis=(0, 1))
            casts.append(abs(float(blue) - float(red)))
        return float(np.mean(casts))

    assert cast(True) < 0.6 * cast(False)
