from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.simulation import WorldConfig
from radcam_depth_ros.simulation.objects.furniture import guard_rail
from radcam_depth_ros.simulation.settings.style import draw_style
from radcam_depth_ros.simulation.world.centre_line import CentreLine
from radcam_depth_ros.simulation.world.street import Stretch

SEEDS = st.integers(0, 2**31)


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS, sign=st.sampled_from([1, -1]), t=st.floats(-20, 20))
def test_what_runs_along_the_road_follows_its_curves(seed: int, sign: int, t: float) -> None:
    rng = np.random.default_rng(seed)
    path = CentreLine(rng, -100, 300, 110.0)
    world = WorldConfig()
    stretch = Stretch(50.0, path, draw_style(rng, world), library=None, rng=rng, people=0.0)  # type: ignore[arg-type]
    stretch.place_along(guard_rail, sign, 50.0, 100.0, t)
    centre = path.position(np.linspace(40, 110, 7001), t)
    points = np.concatenate([part.corners.reshape(-1, 3) for part in stretch.parts])[::7, :2]
    distance = np.linalg.norm(points[:, None] - centre[None], axis=-1).min(axis=1)
    assert distance.max() < 0.2
