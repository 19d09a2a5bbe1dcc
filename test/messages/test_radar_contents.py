from __future__ import annotations

import numpy as np
import pytest

from radcam_depth_ros.frame import RadarReturns
from radcam_depth_ros.messages import FieldAliases, RadarContents, RadarFields

FIELDS = RadarFields(("x", "y", "z"), "snr", ("v",))
GUESSED = RadarFields(("x", "y", "z"), "Intensity", ())
DOPPLER = "expected a Doppler speed in the returns on /radar, "
RCS = "expected an RCS in the returns on /radar, "


def sweep(count, rcs=None, speed=None):
    """Returns with these values, which differ from one to the next where they are not given."""
    values = [
        np.arange(count) if value is None else np.broadcast_to(np.asarray(value, np.float32), count)
        for value in (rcs, speed)
    ]
    rcs_dbsm, speeds = (value.astype(np.float32) for value in values)
    return RadarReturns(np.ones((count, 3), np.float32), rcs_dbsm, speeds, np.zeros(count, np.float32))


def problem_of(*sweeps, fields=FIELDS, aliases=""):
    contents = RadarContents(FieldAliases.parse(aliases))
    for returns in sweeps:
        contents.add(returns, fields)
    return contents.problem("/radar")


def test_a_radar_with_doppler_and_rcs_has_no_problem():
    assert problem_of(sweep(60)) == problem_of() == problem_of(sweep(0)) == ""


def test_the_fields_are_told():
    contents = RadarContents(FieldAliases())
    assert contents.values() == ()
    contents.add(sweep(3), RadarFields(("range", "azimuth"), "", ("vx", "vy")))
    assert dict(contents.values()) == {
        "field of the position": "range azimuth",
        "field of the Doppler speed": "vx vy",
        "field of the RCS": "none",
    }


@pytest.mark.parametrize(
    ("fields", "returns", "texts"),
    [
        (RadarFields(("x", "y"), "", ("v",)), sweep(1), (RCS + "found no field for it", "(rcs=FIELD)", "(rcs=)")),
        (RadarFields(("x", "y"), "snr", ()), sweep(1), (DOPPLER + "found no field", "(radial_speed=FIELD)")),
        (FIELDS, sweep(7, speed=np.nan), (DOPPLER + "got no number in the field v in 7 returns", "look at the driver")),
        (FIELDS, sweep(60, speed=0), (DOPPLER + "got 0 in the field v in all of 60 returns: while nothing moves",)),
        (FIELDS, sweep(60, rcs=-2.5), (RCS + "got -2.5 in the field snr in all of 60 returns: look at the driver",)),
    ],
)
def test_what_is_missing_or_constant_is_named_with_its_remedy(fields, returns, texts):
    found = problem_of(returns, fields=fields)
    assert all(text in found for text in texts), found
    assert found.count("expected") == 1


def test_both_are_told():
    found = problem_of(sweep(1), fields=RadarFields(("x", "y"), "", ()))
    assert DOPPLER in found
    assert RCS in found


def test_few_returns_do_not_tell_that_a_value_is_constant():
    assert problem_of(sweep(20, speed=0), sweep(20, speed=0)) == ""
    assert problem_of(sweep(30, speed=0), sweep(30, speed=0))


def test_what_differed_once_is_not_constant_later():
    assert problem_of(sweep(5), *(sweep(60, rcs=0, speed=0) for _ in range(5))) == ""


def test_another_field_begins_anew():
    contents = RadarContents(FieldAliases())
    contents.add(sweep(60), FIELDS)
    contents.add(sweep(60, speed=0), RadarFields(("x", "y", "z"), "snr", ("doppler",)))
    assert "in the field doppler in all of 60 returns" in contents.problem("/radar")


def test_what_is_not_to_be_read_is_not_missed():
    nothing = RadarFields(("x", "y"), "", ())
    assert problem_of(sweep(1), fields=nothing, aliases="rcs= radial_speed=") == ""
    assert RCS in problem_of(sweep(1), fields=nothing, aliases="radial_speed=")


def drive(sweeps, *, values, fields=GUESSED, aliases="", count=40):
    """What is told of a radar on a vehicle at 6 to 12 m/s, whose intensity has these values by the lines of sight."""
    rng = np.random.default_rng(5)
    contents = RadarContents(FieldAliases.parse(aliases))
    for index in range(sweeps):
        angle, distance = rng.uniform(-0.9, 0.9, count), rng.uniform(5, 80, count)
        xyz = np.stack((distance * np.cos(angle), distance * np.sin(angle), np.zeros(count)), axis=1)
        intensity = values(rng, np.cos(angle), 6 + 0.2 * index)
        unknown = np.full(count, np.nan, np.float32)
        contents.add(RadarReturns(xyz.astype(np.float32), intensity.astype(np.float32), unknown, unknown), fields)
    return contents.problem("/radar")


def doppler(rng, ahead, speed):
    """Of a street: some returns are of others that move."""
    return np.where(rng.random(len(ahead)) < 0.3, rng.uniform(-20, 20, len(ahead)), -speed * ahead)


def test_an_intensity_that_is_likely_doppler_is_named_with_both_remedies():
    found = drive(30, values=doppler)
    assert "field Intensity on /radar, for which it was taken, got values that fit the Doppler" in found
    assert "to radial_speed=Intensity rcs= if they are speeds, else to rcs=Intensity radial_speed=" in found
    assert found.count("expected") == 1


@pytest.mark.parametrize(
    "values",
    [
        lambda rng, ahead, _: rng.normal(10, 8, len(ahead)),
        lambda rng, ahead, _: np.round(rng.normal(20, 2, len(ahead))),
        lambda rng, ahead, _: rng.uniform(0, 1, len(ahead)),
        lambda rng, ahead, _: np.where(rng.random(len(ahead)) < 0.8, 0, 20),
        lambda rng, ahead, _: np.full(len(ahead), 255.0),
        lambda rng, ahead, _: np.full(len(ahead), np.nan),
    ],
    ids=["rcs", "narrow", "unit", "clipped", "saturated", "nothing"],
)
def test_other_intensities_are_no_doppler(values):
    assert "fit the Doppler" not in drive(60, values=values)


@pytest.mark.parametrize(
    ("fields", "aliases"),
    [
        (RadarFields(("x", "y", "z"), "intensity", ("v",)), ""),
        (RadarFields(("x", "y", "z"), "intensity", ()), "rcs=intensity"),
        (RadarFields(("x", "y", "z"), "snr", ()), ""),
    ],
    ids=["beside a Doppler field", "named", "another field"],
)
def test_an_intensity_is_doubted_only_where_it_was_guessed(fields, aliases):
    assert "fit the Doppler" not in drive(30, values=doppler, fields=fields, aliases=aliases)


def test_few_sweeps_do_not_tell():
    assert "fit the Doppler" not in drive(5, values=doppler)
    assert "fit the Doppler" not in drive(60, values=doppler, count=8)
