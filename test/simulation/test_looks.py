from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from radcam_depth_ros import messages, simulation
from radcam_depth_ros.simulation.materials.surfaces import Label
from radcam_depth_ros.simulation.settings.looks import Looks, LooksConfig, draw_looks

NONE = LooksConfig(**dict.fromkeys((entry.name for entry in dataclasses.fields(LooksConfig)), 0.0))


def config(**shares: float) -> simulation.SimulationConfig:
    off = {"street": simulation.StreetKind.TOWN, "view_m": 100.0, "random_textures": 0.0, "random_light": 0.0}
    return simulation.SimulationConfig(
        world=simulation.WorldConfig(**off),
        looks=dataclasses.replace(NONE, **shares),
        camera=simulation.CameraConfig(width=160, height=96, min_focal_length_px=120.0, max_focal_length_px=120.0),
        lidar=simulation.LidarConfig(enabled=False),
        key_frames=True,
    )


def parts(drive: Any) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    """Picture, exact depth and classes of a drive's first image."""
    found = drive.messages
    image = messages.decode_image(found["/camera/image_raw/compressed"][0]).image
    depth = messages.decode_depth(found["/ground_truth/depth"][0]).depth_m
    return image, depth, messages.decode_classes(found["/ground_truth/classes"][0]).classes


def test_shares_decide_what_pictures_have() -> None:
    drawn = [draw_looks(seed, LooksConfig()) for seed in range(400)]
    for name, share in dataclasses.asdict(LooksConfig()).items():
        assert np.mean([getattr(looks, name) for looks in drawn]) == pytest.approx(share, abs=0.1)
    assert {draw_looks(seed, NONE) for seed in range(20)} == {Looks()}
    # The share of one leaves the others as they were.
    more = [draw_looks(seed, dataclasses.replace(LooksConfig(), bonnet=1.0)) for seed in range(400)]
    assert all(
        dataclasses.replace(one, bonnet=True) == other and other.bonnet for one, other in zip(drawn, more, strict=True)
    )


@pytest.mark.parametrize("share", [-0.1, 1.1])
def test_a_share_lies_between_nothing_and_all(share: float) -> None:
    with pytest.raises(simulation.SimulationError, match=r"looks\.dirt must be 0 to 1"):
        LooksConfig(dirt=share)


def test_what_is_painted_leaves_depth_classes_and_radar_as_they_were(record: Any, read: Any) -> None:
    painted = dict.fromkeys(("lettering", "reflections", "wear", "beams", "dirt", "white_balance"), 1.0)
    plain, changed = (read(record(config(**shares), seed=3, frames=1)) for shares in ({}, painted))
    before, after = parts(plain), parts(changed)
    assert np.array_equal(before[1], after[1])
    assert np.array_equal(before[2], after[2])
    for topic in ("/radar/points", "/radar_4d/points"):
        assert np.array_equal(plain.messages[topic][0].data, changed.messages[topic][0].data)
    assert np.abs(before[0].astype(int) - after[0]).mean() > 2


def test_depth_of_the_own_bonnet_is_unknown(record: Any, read: Any) -> None:
    _, exact, classes = parts(read(record(config(), seed=3, frames=1)))
    image, depth, labels = parts(read(record(config(bonnet=1.0), seed=3, frames=1)))
    own = np.isnan(depth)
    assert not np.isnan(exact).any()
    assert 0.005 < own.mean() < 0.3
    assert own[-1].mean() > 0.5
    assert (labels[own] == Label.IGNORE).all()
    assert np.array_equal(depth[~own], exact[~own])
    assert np.array_equal(labels[~own], classes[~own])
    assert image.std() > 10


def test_the_rows_of_a_rolling_shutter_turn_with_the_vehicle(record: Any, read: Any) -> None:
    _, exact, _ = parts(read(record(config(), seed=3, frames=1)))
    _, rolled, _ = parts(read(record(config(rolling_shutter=1.0), seed=3, frames=1)))
    known = np.isfinite(exact) & np.isfinite(rolled)
    change = np.where(known, np.abs(rolled / np.where(known, exact, 1) - 1), np.nan)
    assert np.nanmax(change) > 0
    # The middle row is taken at the image's time, the others before and after it.
    assert np.nanmean(change[46:50]) < 0.5 * np.nanmean(change[[*range(60, 64), *range(92, 96)]])
    assert np.nanmedian(change) < 0.02
