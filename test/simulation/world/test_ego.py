from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.simulation import WorldConfig
from radcam_depth_ros.simulation.settings.style import draw_style
from radcam_depth_ros.simulation.world.centre_line import CentreLine
from radcam_depth_ros.simulation.world.ego import EgoDrive
from radcam_depth_ros.simulation.world.relief import Relief

SEEDS = st.integers(0, 2**31)


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, time=st.floats(0, 60))
def test_the_own_velocity_is_the_change_of_its_pose(seed: int, time: float) -> None:
    rng = np.random.default_rng(seed)
    style = draw_style(rng, WorldConfig())
    relief = Relief(rng, 0.08)
    ego = EgoDrive(rng, style, CentreLine(rng, -100, 3000, style.min_radius_m), relief)
    step = 0.05
    moved = ego.world_from_base(time + step).translation - ego.world_from_base(time - step).translation
    motion = ego.motion(time)
    assert np.allclose(motion.velocity, moved / (2 * step), atol=0.25)
    assert np.diff(ego.s([time, time + 1.0]))[0] >= 0
    assert np.allclose(motion.velocity_at(np.zeros(3)), motion.velocity)
    x, y, z = motion.world_from_base.translation
    assert z == pytest.approx(float(relief.height(x, y)), abs=1e-6)
    # The vehicle stands on the slope: its own plane is the ground's, but for a little pitch and roll of its body.
    rise = np.array([*relief.slope(x, y), -1.0])
    assert abs(motion.world_from_base.rotation[:, 2] @ rise) / np.linalg.norm(rise) > 0.9999
