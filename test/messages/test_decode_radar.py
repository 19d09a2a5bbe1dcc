from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.bags import factory
from radcam_depth_ros.messages import MOST_RETURNS, FieldAliases, MessageError, decode_radar, encode_points

INT8, UINT8, INT16, UINT16, FLOAT32 = 1, 2, 3, 4, 7

XYZ = np.array([[10.0, 0.0, 0.0], [12.0, -5.0, 1.0], [40.0, 9.0, -0.5]])
RANGE = np.linalg.norm(XYZ, axis=1)
AZIMUTH = np.arctan2(XYZ[:, 1], XYZ[:, 0])
ELEVATION = np.arcsin(XYZ[:, 2] / RANGE)
SPEED = [-3.5, 0.0, 7.25]
RCS = [5, -8, 20]
NONE = [np.nan] * 3


def floats(*names_values, start=0):
    return [(name, FLOAT32, start + 4 * index, values) for index, (name, values) in enumerate(names_values)]


POSITION = floats(("x", XYZ[:, 0]), ("y", XYZ[:, 1]), ("z", XYZ[:, 2]))
# Along the line of sight a velocity of unit vector x speed has that speed; the part across it adds nothing.
ALONG = XYZ / RANGE[:, None] * np.array(SPEED)[:, None]
ACROSS = np.cross(XYZ, [0.0, 0.0, 1.0])
VELOCITY = ALONG + ACROSS

FLAT = XYZ * [1, 1, 0]
FLAT_RANGE = np.linalg.norm(FLAT, axis=1)
FLAT_SPEED = (VELOCITY * [1, 1, 0] * FLAT).sum(axis=1) / FLAT_RANGE


def nuscenes():
    values = {"x": XYZ[:, 0], "y": XYZ[:, 1], "z": XYZ[:, 2], "rcs": RCS, "vx": VELOCITY[:, 0], "vy": VELOCITY[:, 1]}
    names = ["x", "y", "z", "dyn_prop", "id", "rcs", "vx", "vy", "vx_comp", "vy_comp", "is_quality_valid"]
    names += ["ambig_state", "x_rms", "y_rms", "invalid_state", "pdh0", "vx_rms", "vy_rms"]
    kinds = [FLOAT32] * 3 + [INT8, INT16] + [FLOAT32] * 5 + [INT8] * 8
    fields, offset = [], 0
    for name, kind in zip(names, kinds, strict=True):
        fields.append((name, kind, offset, values.get(name, [1, 2, 3])))
        offset += {INT8: 1, INT16: 2, FLOAT32: 4}[kind]
    return fields


def nebula_ars548():
    other = [0.1] * 3  # x y z fill 16 bytes, and the whole is aligned to 16
    columns = floats(
        ("azimuth", AZIMUTH),
        ("azimuth_std", other),
        ("elevation", ELEVATION),
        ("elevation_std", other),
        ("range", RANGE),
        ("range_std", other),
        ("range_rate", SPEED),
        ("range_rate_std", other),
        start=16,
    )
    tail = [("rcs", INT8, 48, RCS), ("measurement_id", UINT16, 50, [1, 2, 3]), ("object_id", UINT16, 56, [7] * 3)]
    states = ("positive_predictive_value", 52), ("classification", 53), ("multi_target_probability", 54)
    tail += [(name, UINT8, offset, [9] * 3) for name, offset in (*states, ("ambiguity_flag", 58))]
    return POSITION + columns + tail


def srr520():
    columns = floats(("range", RANGE), ("azimuth", AZIMUTH), ("range_rate", SPEED), start=16)
    return [*POSITION, *columns, ("rcs", UINT8, 28, [0] * 3), ("pdh00", UINT8, 32, [1] * 3), ("snr", FLOAT32, 40, NONE)]


def projected(velocity):
    return (velocity * XYZ).sum(axis=1) / RANGE


PLANAR_SPEED = projected(VELOCITY * [1, 1, 0])

# Layouts of drivers: fields, point_step, and the positions, cross sections and radial speeds to expect.
LAYOUTS = {
    "nuscenes": (nuscenes(), 43, XYZ, RCS, PLANAR_SPEED),
    "ars548 nebula": (nebula_ars548(), 64, XYZ, RCS, SPEED),
    "ars548 robotics-upo": (
        [
            *POSITION,
            *floats(("v", SPEED), ("r", RANGE), start=12),
            ("RCS", INT8, 20, RCS),
            *floats(("azimuth", AZIMUTH), ("elevation", ELEVATION), start=21),
        ],
        29,
        XYZ,
        RCS,
        SPEED,
    ),
    "ars548 unaligned doppler": (
        [
            *POSITION,
            ("intensity", INT8, 12, RCS),
            ("doppler", FLOAT32, 13, SPEED),
            ("classification", UINT8, 17, [0] * 3),
        ],
        18,
        XYZ,
        RCS,
        SPEED,
    ),
    "ars408 cartesian": (
        [
            *POSITION,
            *floats(
                ("intensity", RCS),
                ("velocity_x", VELOCITY[:, 0]),
                ("velocity_y", VELOCITY[:, 1]),
                ("range", RANGE),
                ("azimuth", AZIMUTH),
                start=12,
            ),
        ],
        32,
        XYZ,
        RCS,
        PLANAR_SPEED,
    ),
    "ars408 without x y z": (
        floats(
            ("dist_x", XYZ[:, 0]),
            ("dist_y", XYZ[:, 1]),
            ("vrel_x", VELOCITY[:, 0]),
            ("vrel_y", VELOCITY[:, 1]),
            ("rcs", RCS),
        ),
        20,
        FLAT,
        RCS,
        FLAT_SPEED,
    ),
    "ti mmwave": ([*POSITION, *floats(("intensity", RCS), ("velocity", SPEED), start=16)], 32, XYZ, RCS, SPEED),
    "astyx": ([*POSITION, *floats(("velocity", SPEED), ("intensity", RCS), start=12)], 20, XYZ, RCS, SPEED),
    "astyx as in the data set": (
        floats(("X", XYZ[:, 0]), ("Y", XYZ[:, 1]), ("Z", XYZ[:, 2]), ("V_r", SPEED), ("Mag", RCS)),
        20,
        XYZ,
        RCS,
        SPEED,
    ),
    "pcl xyzi": ([*POSITION, *floats(("intensity", RCS), start=16)], 32, XYZ, RCS, NONE),
    "smartmicro": (
        [
            *POSITION,
            *floats(
                ("radial_speed", SPEED),
                ("power", NONE),
                ("rcs", RCS),
                ("noise", NONE),
                ("snr", NONE),
                ("azimuth_angle", AZIMUTH),
                ("elevation_angle", ELEVATION),
                ("range", RANGE),
                start=12,
            ),
        ],
        44,
        XYZ,
        RCS,
        SPEED,
    ),
    "polar": (
        floats(("range", RANGE), ("azimuth_angle", AZIMUTH), ("elevation_angle", ELEVATION), ("Doppler", SPEED)),
        16,
        XYZ,
        NONE,
        SPEED,
    ),
    "polar without elevation": (
        floats(("range", FLAT_RANGE), ("azimuth", AZIMUTH), ("amplitude", RCS)),
        12,
        FLAT,
        RCS,
        NONE,
    ),
    "compensated velocity only": (
        POSITION + floats(("vx_comp", VELOCITY[:, 0]), ("vy_comp", VELOCITY[:, 1]), start=12),
        20,
        XYZ,
        NONE,
        PLANAR_SPEED,
    ),
    "velocity in three axes": (
        POSITION + floats(("vx", VELOCITY[:, 0]), ("vy", VELOCITY[:, 1]), ("vz", VELOCITY[:, 2]), start=12),
        24,
        XYZ,
        NONE,
        SPEED,
    ),
    "ainstein": (
        [*POSITION, *floats(("speed", SPEED), ("snr", RCS), start=12)],
        20,
        XYZ,
        RCS,
        SPEED,
    ),
    "position only": (POSITION, 12, XYZ, NONE, NONE),
}

SENSOR_FILES = {
    "ars548_nebula": "ars548 nebula",
    "astyx": "astyx",
    "nuscenes_ars408": "nuscenes",
    "smartmicro": "smartmicro",
    "ti_mmwave": "ti mmwave",
}
"""Of each sensor that has a parameter file, the layout of its clouds."""


def test_each_sensor_with_a_parameter_file_has_a_layout() -> None:
    files = Path(__file__).parents[2].joinpath("config", "sensors").glob("*.yaml")
    assert sorted(path.stem for path in files) == sorted(SENSOR_FILES)
    assert set(SENSOR_FILES.values()) <= set(LAYOUTS)


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize(("height", "row_padding"), [(1, 0), (3, 7)])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts(cloud_message, layout, is_bigendian, height, row_padding):
    fields, point_step, xyz, rcs, speed = LAYOUTS[layout]
    message = cloud_message(
        *fields, point_step=point_step, is_bigendian=is_bigendian, height=height, row_padding=row_padding
    )
    reading = decode_radar(message)
    np.testing.assert_allclose(reading.returns.xyz_m, xyz, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(reading.returns.rcs_dbsm, rcs)
    np.testing.assert_allclose(reading.returns.radial_speed_mps, speed, rtol=1e-5, atol=1e-5)
    assert np.isnan(reading.returns.age_s).all()
    assert (reading.stamp_ns, reading.frame_id, reading.dropped) == (3_000_000_005, "radar", 0)


def with_floats_at(message, offset, values):
    message.data = message.data.copy()
    order = ">f4" if message.is_bigendian else "<f4"
    for index, value in enumerate(values):
        at = index * message.point_step + offset
        message.data[at : at + 4] = np.frombuffer(np.array([value], order).tobytes(), np.uint8)
    return message


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize("rcs", [[-12.5, 0.0, 31.75], [1e-3, 7.0, np.nan]])
def test_srr520_declares_uint8_and_stores_float32(cloud_message, is_bigendian, rcs):
    message = cloud_message(*srr520(), point_step=48, is_bigendian=is_bigendian)
    returns = decode_radar(with_floats_at(message, 28, rcs)).returns
    np.testing.assert_array_equal(returns.rcs_dbsm, np.array(rcs, np.float32))
    np.testing.assert_allclose(returns.radial_speed_mps, SPEED)


@pytest.mark.parametrize("filler", [b"\x00\x00\x00", b"\xff\xff\xff", b"\x5a\x5a\x5a"])
def test_a_true_uint8_before_a_gap_stays_one(cloud_message, filler):
    message = cloud_message(*POSITION, ("rcs", UINT8, 12, [3, 0, 255]), ("snr", FLOAT32, 16, NONE))
    message.data = message.data.copy()
    for index in range(3):
        message.data[index * 20 + 13 : index * 20 + 16] = np.frombuffer(filler, np.uint8)
    np.testing.assert_array_equal(decode_radar(message).returns.rcs_dbsm, [3, 0, 255])


def test_a_uint8_without_a_gap_stays_one(cloud_message):
    message = cloud_message(*POSITION, ("rcs", UINT8, 12, [3, 0, 255]), ("id", UINT8, 13, [0] * 3), point_step=16)
    np.testing.assert_array_equal(decode_radar(message).returns.rcs_dbsm, [3, 0, 255])


def test_a_topic_whose_intensity_is_doppler(cloud_message):
    message = cloud_message(*POSITION, ("intensity", FLOAT32, 16, SPEED), point_step=32)
    returns = decode_radar(message, FieldAliases(rcs=(), radial_speed=("intensity",))).returns
    np.testing.assert_allclose(returns.radial_speed_mps, SPEED)
    assert np.isnan(returns.rcs_dbsm).all()


def test_field_names_are_read_from_a_text(cloud_message):
    aliases = FieldAliases.parse("radial_speed=v_d,intensity  rcs=")
    assert (aliases.radial_speed, aliases.rcs, aliases.x) == (("v_d", "intensity"), (), FieldAliases().x)
    assert FieldAliases.parse("") == FieldAliases()
    message = cloud_message(*POSITION, ("intensity", FLOAT32, 16, SPEED), point_step=32)
    np.testing.assert_allclose(decode_radar(message, aliases).returns.radial_speed_mps, SPEED)
    for text, sentence in (
        ("rsc=power", "quantity=field, got 'rsc=power'; did you mean rcs?"),
        ("power", "quantity=field, got 'power'; quantities are x, y,"),
    ):
        with pytest.raises(MessageError, match=re.escape(sentence)):
            FieldAliases.parse(text)


def test_units_and_signs_of_fields(cloud_message):
    columns = (
        ("r", 100 * RANGE),
        ("az", -np.degrees(AZIMUTH)),
        ("el", 1000 * ELEVATION),
        ("v_d", np.multiply(SPEED, -3.6)),
    )
    aliases = FieldAliases.parse("range=r[cm] azimuth=az[-deg] elevation=el[mrad] radial_speed=v_d[-km/h]")
    reading = decode_radar(cloud_message(*floats(*columns)), aliases)
    np.testing.assert_allclose(reading.returns.xyz_m, XYZ, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(reading.returns.radial_speed_mps, SPEED, rtol=1e-5)
    assert reading.fields.position == ("r[cm]", "az[-deg]", "el[mrad]")
    assert reading.fields.radial_speed == ("v_d[-km/h]",)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("azimuth=az[grad]", "unit of azimuth in the radar's fields one of rad, deg, mrad, or with a minus"),
        ("x=a,b[deg]", "unit of x in the radar's fields one of m, cm, mm, km"),
        ("rcs=power[dB]", "unit of rcs in the radar's fields none, got [dB]"),
    ],
)
def test_units_that_there_are_not_are_refused(text, sentence):
    with pytest.raises(MessageError, match=re.escape(sentence)):
        FieldAliases.parse(text)


def test_angles_beyond_a_full_turn_in_the_named_unit_are_refused(cloud_message):
    message = cloud_message(*floats(("range", RANGE), ("azimuth", [0.0, 4500.0, -10.0])))
    with pytest.raises(MessageError, match=r"full turn in the field 'azimuth', got 4500\.0 deg"):
        decode_radar(message, FieldAliases.parse("azimuth=azimuth[deg]"))


def test_a_field_that_was_named_and_is_not_there_is_no_silent_nan(cloud_message):
    message = cloud_message(*POSITION, ("intensity", FLOAT32, 16, SPEED), point_step=32)
    with pytest.raises(MessageError, match=r"field v_d or v_r for radial_speed, .* got x y z intensity"):
        decode_radar(message, FieldAliases.parse("radial_speed=v_d,v_r"))


def test_rows_without_a_position_are_dropped_and_values_that_are_not_finite_are_nan(cloud_message):
    message = cloud_message(
        *floats(
            ("x", [1.0, np.nan, 3.0, 4.0]),
            ("y", [0.0, 0.0, np.inf, 1.0]),
            ("z", [0.0] * 4),
            ("rcs", [np.inf, 2.0, 3.0, 4.0]),
            ("doppler", [-np.inf, 2.0, 3.0, 1.0]),
        )
    )
    reading = decode_radar(message)
    np.testing.assert_array_equal(reading.returns.xyz_m, [[1, 0, 0], [4, 1, 0]])
    np.testing.assert_array_equal(reading.returns.rcs_dbsm, [np.nan, 4])
    np.testing.assert_array_equal(reading.returns.radial_speed_mps, [np.nan, 1])
    assert reading.dropped == 2


def test_a_return_at_the_sensor_has_no_line_of_sight(cloud_message):
    fields = floats(("x", [0.0]), ("y", [0.0]), ("z", [0.0]), ("vx", [3.0]), ("vy", [1.0]))
    assert np.isnan(decode_radar(cloud_message(*fields)).returns.radial_speed_mps).all()


def test_zero_points_and_an_empty_frame(cloud_message):
    message = cloud_message()
    message.header.frame_id = ""
    reading = decode_radar(message)
    assert (len(reading.returns), reading.frame_id, reading.dropped) == (0, "", 0)
    assert len(decode_radar(cloud_message(*((name, kind, at, []) for name, kind, at, _ in nuscenes()))).returns) == 0


def test_a_cloud_without_positions_is_refused(cloud_message):
    with pytest.raises(MessageError, match=r"x y z, or dist_x dist_y, or range and azimuth, got range rcs; .* aliases"):
        decode_radar(cloud_message(*floats(("range", RANGE), ("rcs", RCS))))


def test_angles_in_degrees_are_refused(cloud_message):
    with pytest.raises(MessageError, match=r"radians in the field 'azimuth', got 45\.0"):
        decode_radar(cloud_message(*floats(("range", RANGE), ("azimuth", [0.0, 45.0, -10.0]))))


def test_truncated_data_is_refused(cloud_message):
    message = cloud_message(*POSITION)
    message.data = message.data[:-1]
    with pytest.raises(MessageError, match=r"36 bytes .* got 35; the point cloud is truncated"):
        decode_radar(message)


@settings(max_examples=50, deadline=None)
@given(st.data())
def test_any_fields_give_returns_or_a_sentence(cloud_message, data):
    names = st.sampled_from(["x", "y", "z", "range", "azimuth", "rcs", "vx", "vy", "doppler", "other", ""])
    field = st.tuples(names, st.integers(0, 10), st.integers(0, 30))
    fields = data.draw(st.lists(field, max_size=6))
    count, point_step, size = (data.draw(st.integers(0, limit)) for limit in (5, 40, 250))
    message = cloud_message()
    message.width, message.height, message.point_step, message.row_step = count, 1, point_step, count * point_step
    message.data = np.frombuffer(data.draw(st.binary(min_size=size, max_size=size)), np.uint8)
    message.fields = [type(message)(name=name, datatype=kind, offset=at, count=1) for name, kind, at in fields]
    try:
        reading = decode_radar(message)
    except MessageError:
        return
    assert len(reading.returns) + reading.dropped == count


def test_of_very_many_returns_the_nearest_are_kept_in_their_order():
    count = MOST_RETURNS + 5000
    x = np.random.default_rng(0).permutation(np.linspace(1.0, 300.0, count)).astype(np.float32)
    zeros = np.zeros(count, np.float32)
    x[7] = np.nan
    reading = decode_radar(encode_points(factory, {"x": x, "y": zeros, "z": zeros}, 0, "radar"))
    assert (len(reading.returns), reading.dropped, reading.thinned) == (MOST_RETURNS, 1, 4999)
    nearest = np.sort(x[np.isfinite(x)])[:MOST_RETURNS]
    np.testing.assert_array_equal(np.sort(reading.returns.xyz_m[:, 0]), nearest)
    kept = x[np.isin(x, nearest)]
    np.testing.assert_array_equal(reading.returns.xyz_m[:, 0], kept)


def test_a_nan_that_signals_is_no_value_and_no_warning() -> None:
    x = np.array([0x7FA00000, 0x41200000], np.uint32).view(np.float32)
    cloud = encode_points(factory, {"x": x, "y": np.zeros(2, np.float32), "z": np.zeros(2, np.float32)}, 0, "radar")
    with np.errstate(invalid="raise"):
        returns = decode_radar(cloud).returns
    assert returns.xyz_m[:, 0].tolist() == [10.0]
