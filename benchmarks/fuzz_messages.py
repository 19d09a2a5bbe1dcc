"""Messages as a broken driver or a hostile publisher would send them: good ones with wrong values, and made-up ones.

All are valid on the wire: each value is of its field's type. What a message says may contradict itself.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import random
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
from rosbags.interfaces import Nodetype

from radcam_depth_ros.bags import factory
from radcam_depth_ros.bags.definitions import MessageType
from radcam_depth_ros.frame import CameraModel, ImageArray
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import (
    SCAN_FIELDS,
    OdometryReading,
    StampedTransform,
    encode_camera_info,
    encode_image,
    encode_odometry,
    encode_points,
    encode_transforms,
)

IMAGE, CAMERA_INFO, RADAR, ODOMETRY = "/camera/image_raw", "/camera/camera_info", "/radar/points", "/odom"
STATIC, DYNAMIC = "/tf_static", "/tf"
TYPES = {
    IMAGE: "sensor_msgs/msg/Image",
    CAMERA_INFO: "sensor_msgs/msg/CameraInfo",
    RADAR: "sensor_msgs/msg/PointCloud2",
    ODOMETRY: "nav_msgs/msg/Odometry",
    STATIC: "tf2_msgs/msg/TFMessage",
    DYNAMIC: "tf2_msgs/msg/TFMessage",
}
CAMERA = CameraModel(96, 64, 630.0, 630.0, 47.5, 31.5)
CAMERA_FROM_RADAR = RigidTransform(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.array([0.1, 0.2, -1.0]))
RETURNS = np.array([[8.0, 0.3, 0], [20, -0.8, 0.2], [35, 1.5, 0.1], [12, 0.5, 0]], np.float32)
PICTURE: ImageArray = np.random.default_rng(0).integers(0, 255, (CAMERA.height, CAMERA.width, 3), dtype=np.uint8)

_FLOATS = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e-320, 1e-30, 1e-3, 1e3, 1e9, 1e30, 3.5e38, 1e200, -1.7e308)
_INTEGERS = (0, 1, 2, 3, 7, 32, 95, 96, 255, 32_768, 100_000, 999_999_999, 2**31 - 1, 2**32 - 1, -1, -(2**31))
# No link has the sensors as parents, so that a good one can always be set again without closing a circle.
_NAMES = ("", "camera", "/camera", "odom", "map", "a", "b", "/", "x" * 5000, "ü\n\x00", "camera ")
_DISTORTIONS = ("plumb_bob", "rational_polynomial", "equidistant", "fisheye", "", "unknown")
_ENCODINGS = {
    **dict.fromkeys(("mono8", "8UC1", "bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8", "nv12", "nv21"), 1),
    **dict.fromkeys(("mono16", "bayer_rggb16", "bayer_grbg16", "yuv422", "uyvy", "yuyv", "yuv422_yuy2"), 2),
    **dict.fromkeys(("rgb8", "bgr8", "8UC3", "RGB8"), 3),
    **dict.fromkeys(("rgba8", "bgra8", "8UC4", "32FC1"), 4),
    **dict.fromkeys(("rgb16", "bgr16"), 6),
    **dict.fromkeys(("rgba16", "bgra16"), 8),
}
_FIELD_FORMATS = ("b", "B", "h", "H", "i", "I", "f", "d")
_FIELD_NAMES = ("x", "y", "z", "range", "azimuth", "elevation", "rcs", "intensity", "doppler", "velocity", "vx", "vy")


@dataclass(frozen=True)
class Sent:
    """One message.

    Attributes:
        kind: What was done to it.
        topic: Where it goes.
        message: The message.
    """

    kind: str
    topic: str
    message: Any


@dataclass(frozen=True)
class _Leaf:
    """One value of a message, or a sequence of them, with its primitive type; None where it is of messages."""

    holder: Any
    name: str
    primitive: str | None
    is_fixed: bool

    @property
    def is_sequence(self) -> bool:
        return not isinstance(getattr(self.holder, self.name), (str, bool, int, float))


def good(topic: str, stamp_ns: int) -> Any:
    """A message of a topic that can be used, with attributes that can be set."""
    message = thawed(_good_once(topic))
    stamp = _stamp(stamp_ns)
    for stamped in message.transforms if topic in (STATIC, DYNAMIC) else (message,):
        stamped.header.stamp = stamp
    return message


@functools.cache
def _good_once(topic: str) -> Any:
    if topic == IMAGE:
        return encode_image(factory, PICTURE, 0, "camera")
    if topic == CAMERA_INFO:
        return encode_camera_info(factory, CAMERA, 0, "camera")
    if topic == RADAR:
        columns = dict(zip("xyz", RETURNS.T, strict=True)) | {"rcs": np.full(4, 5, np.float32)}
        return encode_points(factory, columns, 0, "radar")
    if topic == ODOMETRY:
        pose = RigidTransform.identity()
        return encode_odometry(factory, OdometryReading(0, "odom", "base_link", pose, np.zeros(3), np.zeros(3)))
    on_vehicle = dataclasses.replace(CAMERA_FROM_RADAR, translation=np.array([0.0, 1.4, 0.0]))
    links = {"radar": CAMERA_FROM_RADAR, "base_link": on_vehicle, "base_footprint": on_vehicle}
    return encode_transforms(factory, [StampedTransform("camera", child, 0, pose) for child, pose in links.items()])


def _stamp(stamp_ns: int) -> Any:
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return SimpleNamespace(sec=seconds, nanosec=nanoseconds)


def bad(rng: random.Random, stamp_ns: int) -> list[Sent]:
    """Messages of one kind, most of them wrong in one way or another."""
    make = rng.choices(
        (_mutated, _cloud, _scan, _image, _compressed, _other_camera, _links, _unchanged), (6, 4, 2, 3, 3, 1, 1, 5)
    )[0]
    return make(rng, stamp_ns)


def thawed(value: Any) -> Any:
    """A message whose attributes, and those of the messages within, can be set."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = dataclasses.fields(value)
        return SimpleNamespace(**{item.name: thawed(getattr(value, item.name)) for item in fields})
    if isinstance(value, list):
        return [thawed(item) for item in value]
    return value.copy() if isinstance(value, np.ndarray) else value


def _leaves(type_name: str, message: Any) -> Iterator[_Leaf]:
    for name, (kind, what) in MessageType.jazzy(type_name).typestore.fielddefs[type_name][1]:
        if not hasattr(message, name):
            continue
        if kind == Nodetype.NAME:
            yield from _leaves(what, getattr(message, name))
        elif kind == Nodetype.BASE:
            yield _Leaf(message, name, what[0], True)
        else:
            (element_kind, element), _ = what
            is_message = element_kind == Nodetype.NAME
            yield _Leaf(message, name, None if is_message else element[0], kind == Nodetype.ARRAY)
            for item in getattr(message, name) if is_message else ():
                yield from _leaves(element, item)


def _unchanged(rng: random.Random, stamp_ns: int) -> list[Sent]:
    """Good messages: what is wrong before and after them then reaches a frame."""
    return [
        Sent(f"good {TYPES[topic].rsplit('/', 1)[-1]}", topic, good(topic, stamp_ns))
        for topic in rng.choice(((CAMERA_INFO, RADAR, IMAGE), (CAMERA_INFO, STATIC), (CAMERA_INFO, ODOMETRY)))
    ]


def _mutated(rng: random.Random, stamp_ns: int) -> list[Sent]:
    """A good message with one to four values changed."""
    topic = rng.choice(list(TYPES))
    message = good(topic, stamp_ns)
    for _ in range(rng.randint(1, 4)):
        leaves = list(_leaves(TYPES[topic], message))
        _change(rng, rng.choice(leaves))
    return [Sent(f"changed {TYPES[topic].rsplit('/', 1)[-1]}", topic, message)]


def _change(rng: random.Random, leaf: _Leaf) -> None:
    value = getattr(leaf.holder, leaf.name)
    if not leaf.is_sequence:
        changed: Any = _scalar(rng, leaf.primitive or "")
    elif leaf.primitive is None:
        changed = rng.choice((list, lambda items: items[:1], lambda items: items * 20, lambda items: items[::-1]))(
            [] if rng.random() < 0.2 else value
        )
    elif leaf.primitive == "uint8":
        changed = np.frombuffer(_cut(rng, value.tobytes()), np.uint8)
    else:
        size = len(value) if leaf.is_fixed else rng.choice((0, 1, 4, 5, 8, 12, 14, 20, 5000))
        changed = np.resize(value, size) if len(value) else np.zeros(size)
        for _ in range(rng.randint(0, 4)):
            if size:
                changed[rng.randrange(size)] = _float(rng)
    setattr(leaf.holder, leaf.name, changed)


def _scalar(rng: random.Random, primitive: str) -> Any:
    if primitive == "string":
        return rng.choice((*_NAMES, *_DISTORTIONS, *_ENCODINGS))
    if primitive == "bool":
        return rng.random() < 0.5
    if primitive.startswith("float"):
        return _float(rng)
    bounds = np.iinfo(np.dtype(primitive))
    value = rng.choice((*_INTEGERS, rng.randint(0, 300), rng.randint(int(bounds.min), int(bounds.max))))
    return min(max(value, int(bounds.min)), int(bounds.max))


def _float(rng: random.Random) -> float:
    return rng.choice((*_FLOATS, rng.uniform(-2, 2), rng.uniform(-1e3, 1e3), 10 ** rng.uniform(-12, 12)))


def _cut(rng: random.Random, content: bytes) -> bytes:
    """Cut off, lengthened, turned over in places, replaced, or as it was."""
    how = rng.randrange(5)
    if how == 0:
        return content[: rng.randint(0, len(content))]
    if how == 1:
        return content + rng.randbytes(rng.randint(1, 100))
    if how == 2:
        return rng.randbytes(rng.randint(0, 200))
    changed = bytearray(content)
    for _ in range(rng.randint(1, 10) if how == 3 and content else 0):
        changed[rng.randrange(len(changed))] = rng.randrange(256)
    return bytes(changed)


def _header(rng: random.Random, stamp_ns: int, frame_id: str) -> Any:
    stamp = _stamp(stamp_ns)
    if rng.random() < 0.05:
        stamp.sec, stamp.nanosec = _scalar(rng, "int32"), _scalar(rng, "uint32")
    return SimpleNamespace(stamp=stamp, frame_id=rng.choice(_NAMES) if rng.random() < 0.05 else frame_id)


def _cloud(rng: random.Random, stamp_ns: int) -> list[Sent]:
    """A cloud of any layout, whose sizes may lie."""
    order = rng.choice("<>")
    names = rng.sample(_FIELD_NAMES, rng.randint(0, 6))
    if rng.random() < 0.7:
        names = [*rng.choice((("x", "y", "z"), ("range", "azimuth"))), *names]
    fields, offset = [], 0
    for name in names:
        offset += rng.choice((0, 0, 0, 1, 4))
        datatype = rng.choice((7, 7, rng.randint(1, 8)))
        fields.append(SimpleNamespace(name=name, offset=offset, datatype=datatype, count=rng.choice((1, 1, 0, 3))))
        offset += struct.calcsize("<" + _FIELD_FORMATS[datatype - 1])
    point_step, height, width = offset + rng.choice((0, 0, 4, 13)), rng.choice((1, 1, 2, 0)), rng.choice((0, 1, 5, 60))
    row_step = width * point_step + rng.choice((0, 0, 7))
    data = bytearray(rng.randbytes(row_step * height))
    for field in fields:
        code = _FIELD_FORMATS[field.datatype - 1]
        for at in range(field.offset, len(data) - 8, max(point_step, 1)) if code in "fd" else ():
            value = rng.uniform(-6, 60) if rng.random() < 0.9 else _float(rng)
            if code == "f" and abs(value) > 3.4e38:
                value = math.inf
            struct.pack_into(order + code, data, at, value)
    message = SimpleNamespace(
        header=_header(rng, stamp_ns, "radar"),
        height=height,
        width=width,
        fields=fields,
        is_bigendian=order == ">",
        point_step=point_step,
        row_step=row_step,
        data=np.frombuffer(bytes(data), np.uint8),
        is_dense=rng.random() < 0.5,
    )
    return [Sent(_lie(rng, "PointCloud2", message, TYPES[RADAR]), RADAR, message)]


def _scan(rng: random.Random, stamp_ns: int) -> list[Sent]:
    """A RadarScan, in degrees or with any values, with none or very many returns."""
    unit = rng.choice((1.0, 1.0, 180 / math.pi))
    limits = {"range": (0, 90), "azimuth": (-unit, unit), "elevation": (-0.2 * unit, 0.2 * unit)}
    returns = []
    for _ in range(rng.choice((0, 1, 5, 60, 60, 3000))):
        values = {name: rng.uniform(*limits.get(name, (-20, 20))) for name in SCAN_FIELDS}
        if rng.random() < 0.1:
            values[rng.choice(SCAN_FIELDS)] = struct.unpack("f", rng.randbytes(4))[0]
        returns.append(SimpleNamespace(**values))
    message = SimpleNamespace(header=_header(rng, stamp_ns, "radar"), returns=returns)
    return [Sent("RadarScan", RADAR, message)]


def _image(rng: random.Random, stamp_ns: int) -> list[Sent]:
    """An image of any encoding, whose sizes may lie."""
    encoding = rng.choice(list(_ENCODINGS))
    width, height = (CAMERA.width, CAMERA.height) if rng.random() < 0.5 else (rng.randint(1, 40), rng.randint(1, 40))
    step = width * _ENCODINGS[encoding] + rng.choice((0, 0, 1, 5))
    rows = height * 3 // 2 if encoding.startswith("nv") else height
    message = SimpleNamespace(
        header=_header(rng, stamp_ns, "camera"),
        encoding=encoding,
        width=width,
        height=height,
        data=np.frombuffer(rng.randbytes(step * rows), np.uint8),
        step=step,
        is_bigendian=rng.randrange(2),
    )
    return [Sent(_lie(rng, "Image", message, TYPES[IMAGE]), IMAGE, message)]


def _lie(rng: random.Random, kind: str, message: Any, type_name: str) -> str:
    """Changes sizes of half the messages; returns what was done."""
    if rng.random() < 0.5:
        return f"made-up {kind}"
    for _ in range(rng.randint(1, 2)):
        names = ("width", "height", "step", "row_step", "point_step", "data", "offset", "datatype", "encoding")
        _change(rng, rng.choice([leaf for leaf in _leaves(type_name, message) if leaf.name in names]))
    return f"lying {kind}"


@functools.cache
def _file(image_format: str, *, progressive: bool = False) -> bytes:
    """The picture as a JPEG, progressive or not, or PNG."""
    how = (cv2.IMWRITE_JPEG_PROGRESSIVE, 1) if progressive else ()
    encoded = cv2.imencode(f".{image_format}", PICTURE[..., ::-1], how)[1]
    return bytes(encoded.tobytes())


def _compressed(rng: random.Random, stamp_ns: int) -> list[Sent]:
    """A JPEG or PNG that is damaged, or whose header claims another size."""
    image_format = rng.choice(("jpeg", "png"))
    is_progressive = image_format == "jpeg" and rng.random() < 0.5
    content = bytearray(_file(image_format, progressive=is_progressive))
    if is_progressive and rng.random() < 0.3:  # the last scan again and again
        scan = content[content.rfind(b"\xff\xda") : -2]
        content[-2:] = scan * rng.choice((1, 30, 100)) + b"\xff\xd9"
    if rng.random() < 0.4:
        if image_format == "png":
            content[16:24] = struct.pack(">II", *(_scalar(rng, "uint32") for _ in range(2)))
            content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
        else:
            at = content.find(b"\xff\xc2" if is_progressive else b"\xff\xc0") + 5
            content[at : at + 4] = struct.pack(">HH", *(rng.choice((0, 1, 64, 96, 33_000, 65_535)) for _ in range(2)))
    if rng.random() < 0.5:
        content = bytearray(_cut(rng, bytes(content)) + rng.choice((b"", b"\xff\xd9", b"IEND")))
    data = np.frombuffer(bytes(content), np.uint8)
    described = rng.choice((image_format, "", "rgb8; jpeg compressed rgb8", "h264"))
    message = SimpleNamespace(header=_header(rng, stamp_ns, "camera"), format=described, data=data)
    return [Sent(f"CompressedImage {image_format}", IMAGE, message)]


def _other_camera(rng: random.Random, stamp_ns: int) -> list[Sent]:
    """A calibration of any kind with an image of its size."""
    info = good(CAMERA_INFO, stamp_ns)
    info.width, info.height = rng.randint(1, 200), rng.randint(1, 150)
    focal = rng.choice((630.0, rng.uniform(1, 3000), _float(rng)))
    info.k[[0, 4]] = focal
    info.p[[0, 5]] = rng.choice((0.0, focal, rng.uniform(1, 3000)))
    info.distortion_model = rng.choice(_DISTORTIONS)
    scale = rng.choice((0.0, 0.1, 10.0, 1e6))
    info.d = np.array([scale * rng.uniform(-1, 1) for _ in range(rng.choice((0, 4, 5, 8, 12, 14)))])
    if rng.random() < 0.3:
        _change(rng, _Leaf(info, rng.choice(("k", "r", "p")), "float64", True))
    image = encode_image(factory, np.zeros((info.height, info.width, 3), np.uint8), stamp_ns, "camera")
    return [Sent("other CameraInfo", CAMERA_INFO, info), Sent("other Image", IMAGE, image)]


def _links(rng: random.Random, stamp_ns: int) -> list[Sent]:
    """Links between frames of many names, in chains."""
    message = good(STATIC, stamp_ns)
    start = rng.randrange(500)
    links = message.transforms * rng.choice((1, 20))
    message.transforms = []
    for number, link in enumerate(links):
        name, parent = f"frame{start + number}", f"frame{start + number - 1}"
        chained = SimpleNamespace(header=_header(rng, stamp_ns, parent), child_frame_id=name, transform=link.transform)
        message.transforms.append(chained)
    return [Sent("chained TFMessage", rng.choice((STATIC, DYNAMIC)), message)]
