"""Radars whose clock differs from the camera's by a known offset."""

import pytest

from radcam_depth_ros.pairing import Pairer, PairingConfig, PairingError

MS = 1_000_000


def test_the_radars_stamps_can_be_corrected():
    pairer = Pairer(("radar",), PairingConfig(radar_time_offset_s=-0.05))
    pairer.add_sweep("radar", 1050 * MS, "sweep", 0)
    (pair,) = pairer.add_image(1000 * MS, "image", 0)  # a sweep of the same time: no wait
    assert (pair.sweeps, pair.offsets_s) == (("sweep",), (0.0,))


def test_each_radar_s_stamps_can_be_corrected_apart():
    pairer = Pairer(("front", "rear"), PairingConfig(radar_time_offset_s=(0.0, -0.05)))
    pairer.add_sweep("front", 1000 * MS, "front sweep", 0)
    pairer.add_sweep("rear", 1050 * MS, "rear sweep", 0)
    (pair,) = pairer.add_image(1000 * MS, "image", 0)
    assert (pair.sweeps, pair.offsets_s) == (("front sweep", "rear sweep"), (0.0, 0.0))
    with pytest.raises(PairingError, match=r"radar_time_offset_s needs one value .* one for each of 3, got 2"):
        Pairer(("front", "rear", "side"), PairingConfig(radar_time_offset_s=(0.0, -0.05)))
