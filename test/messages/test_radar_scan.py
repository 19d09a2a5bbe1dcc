"""RadarScan: the same returns as of a cloud, and what drivers do wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from radar_scans import SCAN, encode_scan, polar

from radcam_depth_ros.bags import MOST_SCAN_BYTES, BagError, deserialise, factory
from radcam_depth_ros.bags.definitions import MessageType
from radcam_depth_ros.messages import (
    MOST_RETURNS,
    SCAN_FIELDS,
    FieldAliases,
    MessageError,
    RadarFields,
    decode_radar,
    encode_points,
)

PACKAGE = Path(__file__).parents[2] / "scripts/message_packages/radar_msgs/msg"
XYZ = np.array([[10.0, 0, 0], [12, -5, 1], [40, 9, -0.5]], np.float32)


def scan(**columns):
    return encode_scan(factory, {**polar(XYZ), **columns}, 3_000_000_005, "radar")


def sent(message):
    return deserialise(bytes(MessageType.jazzy(SCAN).serialise(message, "/radar")), SCAN)


def test_the_definitions_of_bags_and_of_the_generated_package_are_one():
    store = MessageType.jazzy(SCAN).typestore
    assert [name for name, _ in store.fielddefs[SCAN][1]] == ["header", "returns"]
    lines = PACKAGE.joinpath("RadarReturn.msg").read_text(encoding="utf-8").split("\n")
    assert tuple(line.removeprefix("float32 ") for line in lines if line) == SCAN_FIELDS
    assert tuple(name for name, _ in store.fielddefs["radar_msgs/msg/RadarReturn"][1]) == SCAN_FIELDS


def test_a_scan_is_read_with_its_quantities():
    reading = decode_radar(sent(scan(doppler_velocity=[-3.5, 0, 7], amplitude=[5, -8, 20])))
    np.testing.assert_allclose(reading.returns.xyz_m, XYZ, rtol=1e-5, atol=1e-5)
    np.testing.assert_array_equal(reading.returns.radial_speed_mps, np.float32([-3.5, 0, 7]))
    np.testing.assert_array_equal(reading.returns.rcs_dbsm, np.float32([5, -8, 20]))
    assert (reading.stamp_ns, reading.frame_id, reading.dropped) == (3_000_000_005, "radar", 0)
    assert reading.fields == RadarFields(SCAN_FIELDS[:3], "amplitude", ("doppler_velocity",))


VALUES = st.floats(-100, 100, width=32) | st.just(float("nan"))
RETURNS = st.lists(
    st.tuples(st.floats(0, 300, width=32), st.floats(-3, 3, width=32), st.floats(-1.5, 1.5, width=32), VALUES, VALUES),
    max_size=30,
)


@settings(max_examples=60, deadline=None)
@given(RETURNS)
def test_a_scan_gives_what_the_polar_cloud_of_its_returns_gives(rows):
    table = np.array(rows, np.float32).reshape(-1, 5)
    columns = dict(zip(SCAN_FIELDS, table.T, strict=True))
    read, cloud = (
        decode_radar(message)
        for message in (sent(encode_scan(factory, columns, 7, "r")), encode_points(factory, columns, 7, "r"))
    )
    for name in ("xyz_m", "radial_speed_mps", "rcs_dbsm"):
        np.testing.assert_array_equal(getattr(read.returns, name), getattr(cloud.returns, name))
    assert (read.dropped, read.fields) == (cloud.dropped, cloud.fields)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-200, 200, width=32)] * 3), min_size=1, max_size=30))
def test_points_come_back_from_a_scan(points):
    xyz = np.array(points, np.float32)
    returns = decode_radar(encode_scan(factory, polar(xyz), 0, "r")).returns
    np.testing.assert_allclose(returns.xyz_m, xyz, atol=2e-4)


def test_returns_without_a_range_are_left_out_and_counted():
    reading = decode_radar(scan(range=[np.nan, 13, np.inf]))
    assert (len(reading.returns), reading.dropped) == (1, 2)


@pytest.mark.parametrize("elevation", [np.nan, 0.0])
def test_a_scan_without_elevations_is_level(elevation):
    reading = decode_radar(scan(elevation=[elevation] * 3))
    assert len(reading.returns) == 3
    assert not reading.returns.xyz_m[:, 2].any()
    assert ("elevation" in reading.fields.position) == (elevation == 0)


def test_single_returns_without_an_elevation_are_left_out():
    reading = decode_radar(scan(elevation=[np.nan, 0.1, 0.0]))
    assert (len(reading.returns), reading.dropped) == (2, 1)


@pytest.mark.parametrize("quantity", ["azimuth", "elevation"])
def test_angles_in_degrees_are_named_and_can_be_read(quantity):
    degrees = scan(**{quantity: np.degrees(polar(XYZ)[quantity]) + np.array([0, 0, 40])})
    with pytest.raises(MessageError, match=rf"radians in the field '{quantity}', .* {quantity}={quantity}\[deg\]"):
        decode_radar(degrees)
    plain = decode_radar(scan(**{quantity: polar(XYZ)[quantity] + np.radians([0, 0, 40])}))
    reading = decode_radar(degrees, FieldAliases.parse(f"{quantity}={quantity}[deg]"))
    np.testing.assert_allclose(reading.returns.xyz_m, plain.returns.xyz_m, rtol=1e-4, atol=1e-4)
    assert f"{quantity}[deg]" in reading.fields.position


def test_of_100_000_returns_the_nearest_are_kept():
    count = 100_000
    ranges = np.random.default_rng(0).permutation(np.linspace(1, 300, count)).astype(np.float32)
    message = sent(encode_scan(factory, {"range": ranges}, 0, "radar"))
    reading = decode_radar(message)
    assert (len(reading.returns), reading.thinned) == (MOST_RETURNS, count - MOST_RETURNS)
    assert reading.returns.xyz_m[:, 0].max() <= np.sort(ranges)[MOST_RETURNS - 1]


def test_a_scan_beyond_what_is_read_is_refused_before_it_is_read():
    with pytest.raises(BagError, match="a scan on /radar has 5 MiB of at most 4 MiB; set a threshold"):
        MessageType.jazzy(SCAN).deserialise(bytes(MOST_SCAN_BYTES + 1024**2), "/radar")


def test_an_empty_scan_has_no_returns():
    assert len(decode_radar(encode_scan(factory, {}, 0, "radar")).returns) == 0


def test_a_message_with_returns_of_another_kind_is_named():
    message = scan()
    message.returns = [object()]
    with pytest.raises(MessageError, match="expected a radar_msgs/RadarReturn, got a object without range"):
        decode_radar(message)
