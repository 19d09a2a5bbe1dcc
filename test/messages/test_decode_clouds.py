from __future__ import annotations

import numpy as np
import pytest

from radcam_depth_ros.messages import MessageError, decode_points

INT8, UINT16, FLOAT32, FLOAT64 = 1, 4, 7, 8
X, Y, Z = [1.0, 2.0, 3.0, 4.0], [-1.0, 0.5, 0.0, 7.25], [0.25, 0.0, -2.0, 9.0]


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize(("height", "row_padding"), [(1, 0), (2, 0), (2, 11), (4, 3), (1, 5)])
def test_organised_and_padded_clouds_of_both_endiannesses(cloud_message, is_bigendian, height, row_padding):
    message = cloud_message(
        ("x", FLOAT32, 0, X),
        ("y", FLOAT32, 4, Y),
        ("z", FLOAT32, 8, Z),
        ("intensity", FLOAT32, 16, X),
        point_step=32,
        is_bigendian=is_bigendian,
        height=height,
        row_padding=row_padding,
    )
    reading = decode_points(message)
    np.testing.assert_array_equal(reading.xyz_m, np.array([X, Y, Z], np.float32).T)
    assert reading.xyz_m.dtype == np.float32
    assert reading.xyz_m.dtype.isnative
    assert reading.dropped == 0
    assert (reading.stamp_ns, reading.frame_id) == (3_000_000_005, "radar")


def test_other_datatypes_and_unaligned_offsets(cloud_message):
    fields = [("z", INT8, 0, [1, -2]), ("y", FLOAT64, 1, [0.5, 1.5]), ("x", UINT16, 9, [3, 60000])]
    np.testing.assert_array_equal(decode_points(cloud_message(*fields)).xyz_m, [[3, 0.5, 1], [60000, 1.5, -2]])


def test_rows_that_are_not_finite_are_dropped_and_counted(cloud_message):
    values = [np.nan, 1.0, 2.0, -np.inf, 3.0]
    message = cloud_message(
        ("x", FLOAT32, 0, values), ("y", FLOAT32, 4, [0.0] * 5), ("z", FLOAT64, 8, [0, 0, 1e300, 0, 0])
    )
    reading = decode_points(message)
    np.testing.assert_array_equal(reading.xyz_m, [[1, 0, 0], [3, 0, 0]])
    assert reading.dropped == 3


def test_zero_points(cloud_message):
    for message in (
        cloud_message(),
        cloud_message(("x", FLOAT32, 0, []), ("y", FLOAT32, 4, []), ("z", FLOAT32, 8, [])),
    ):
        assert decode_points(message).xyz_m.shape == (0, 3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"row_step": 47}, ["row_step", "4 x 12 = 48", "got 47"]),
        ({"row_step": 0}, ["row_step", "got 0"]),
        ({"point_step": 0}, ["row_step", "4 x 0"]),
        ({"point_step": 11}, ["'z'", "point_step 11", "byte 12"]),
        ({"data": np.zeros(47, np.uint8)}, ["48 bytes", "got 47", "truncated"]),
        ({"width": 5, "row_step": 60}, ["60 bytes", "got 48"]),
        ({"height": 2}, ["96 bytes", "got 48"]),
    ],
)
def test_inconsistent_clouds_are_refused_with_a_sentence(cloud_message, changes, words):
    message = cloud_message(("x", FLOAT32, 0, X), ("y", FLOAT32, 4, Y), ("z", FLOAT32, 8, Z))
    vars(message).update(changes)
    with pytest.raises(MessageError) as raised:
        decode_points(message)
    for word in words:
        assert word in str(raised.value)


def test_a_missing_field_and_an_unknown_datatype_are_refused(cloud_message):
    with pytest.raises(MessageError, match="fields x y z, got x y intensity"):
        decode_points(cloud_message(("x", FLOAT32, 0, X), ("y", FLOAT32, 4, Y), ("intensity", FLOAT32, 8, Z)))
    message = cloud_message(("x", FLOAT32, 0, X), ("y", FLOAT32, 4, Y), ("z", FLOAT32, 8, Z))
    message.fields[1].datatype = 9
    with pytest.raises(MessageError, match=r"1 \(INT8\) to 8 \(FLOAT64\) .* 'y', got 9"):
        decode_points(message)
