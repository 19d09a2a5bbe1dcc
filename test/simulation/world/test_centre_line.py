from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface
from radcam_depth_ros.simulation.objects.mesh import box
from radcam_depth_ros.simulation.world.centre_line import CentreLine

SEEDS = st.integers(0, 2**31)
STEEL = Material(Surface.METAL, Label.POLE)


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, s=st.floats(-150, 900), t=st.floats(-10, 10))
def test_the_road_is_measured_in_metres(seed: int, s: float, t: float) -> None:
    path = CentreLine(np.random.default_rng(seed), -100, 800, 140.0)
    here, there = path.position([s, s + 0.5], [0.0, 0.0])
    assert np.linalg.norm(there - here) == pytest.approx(0.5, abs=0.01)
    assert np.linalg.norm(path.position(s, t) - path.position(s, 0.0)) == pytest.approx(abs(t), abs=1e-6)
    assert np.allclose(path.position(0.0, 0.0), 0.0)


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, s=st.floats(-90, 790), t=st.floats(-80, 80), steepest=st.floats(0.0, 0.1))
def test_banks_are_no_steeper_than_asked_and_end_beside_the_road(
    seed: int, s: float, t: float, steepest: float
) -> None:
    path = CentreLine(np.random.default_rng(seed), -100, 800, 140.0, steepest)
    low, high = path.camber(s, np.array([t - 0.01, t + 0.01]))
    assert abs(high - low) / 0.02 <= steepest + 1e-6
    assert float(path.camber(s, 0.0)) == 0.0
    if abs(t) >= 60:
        assert float(path.camber(s, t)) == 0.0
    x, y = path.position(s, t)
    lifted = path.tilted(box([0.2, 0.2, 1.0], [0, 0, 0.5], STEEL).moved((float(x), float(y), 0.0)), s, t)
    assert lifted.corners[..., 2].mean() == pytest.approx(0.5 + float(path.camber(s, t)), abs=0.01)
