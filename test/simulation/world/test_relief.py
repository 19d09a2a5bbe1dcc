from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface
from radcam_depth_ros.simulation.objects.mesh import box
from radcam_depth_ros.simulation.world.relief import Relief

PLAIN = Material(Surface.METAL, Label.POLE)
SEEDS = st.integers(0, 2**31)


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, x=st.floats(-2000, 2000), y=st.floats(-2000, 2000), steepest=st.floats(0, 0.2))
def test_no_hill_is_steeper_than_asked(seed: int, x: float, y: float, steepest: float) -> None:
    relief = Relief(np.random.default_rng(seed), steepest)
    assert np.linalg.norm(relief.slope(x, y)) <= steepest + 1e-6
    assert float(relief.height(0.0, 0.0)) == pytest.approx(0.0, abs=1e-9)
    lifted = relief.lifted(box([1.0, 1.0, 1.0], [x, y, 0.5], PLAIN))
    assert lifted.corners[..., 2].mean() == pytest.approx(0.5 + float(relief.height(x, y)), abs=0.01)


def test_hills_are_common_and_flat_land_too() -> None:
    slopes = [np.linalg.norm(Relief(np.random.default_rng(seed), 0.05).slope(50.0, 20.0)) for seed in range(60)]
    assert 10 < np.count_nonzero(slopes) < 50
    assert max(slopes) > 0.01
