from __future__ import annotations

import array
import importlib
import struct
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

FORMATS = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}
SIZES = {datatype: struct.calcsize("<" + code) for datatype, code in FORMATS.items()}


@dataclass(frozen=True)
class Maker:
    """One kind of messages: how to build one, and how to send one through its serialisation."""

    make: Callable[..., Any]
    send: Callable[[Any, str], Any]
    has_tf2: bool


def _rosbags() -> Maker:
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)

    def make(type_name: str, **fields: object) -> Any:
        return store.types[type_name](**fields)

    def send(message: Any, type_name: str) -> Any:
        return store.deserialize_cdr(store.serialize_cdr(message, type_name), type_name)

    return Maker(make, send, has_tf2=True)


def _namespaces() -> Maker:
    return Maker(lambda _, **fields: SimpleNamespace(**fields), lambda message, _: message, has_tf2=True)


def _rclpy() -> Maker:
    for package in ("sensor_msgs", "nav_msgs"):
        pytest.importorskip(f"{package}.msg")
    with warnings.catch_warnings():
        # The generator loads a parser that imports a deprecated module, once, with the first message.
        warnings.simplefilter("ignore", DeprecationWarning)
        pytest.importorskip("rosidl_generator_py")
    serialization = pytest.importorskip("rclpy.serialization")

    def type_of(type_name: str) -> Any:
        package, _, name = type_name.split("/")
        return getattr(importlib.import_module(f"{package}.msg"), name)

    def make(type_name: str, **fields: Any) -> Any:
        message = type_of(type_name)(check_fields=True)
        for name, value in fields.items():
            default = getattr(message, name)
            if isinstance(default, array.array):
                sequence = array.array(default.typecode)
                sequence.frombytes(memoryview(value).cast("B"))
                value = sequence
            setattr(message, name, value)
        return message

    def send(message: Any, type_name: str) -> Any:
        return serialization.deserialize_message(serialization.serialize_message(message), type_of(type_name))

    return Maker(make, send, has_tf2=False)


@pytest.fixture(scope="session", params=[_rosbags, _namespaces, _rclpy], ids=["rosbags", "namespaces", "rclpy"])
def maker(request: pytest.FixtureRequest) -> Maker:
    return request.param()


@pytest.fixture(scope="session")
def make() -> Callable[..., Any]:
    return _namespaces().make


def header(frame_id: str = "sensor", seconds: int = 3, nanoseconds: int = 5) -> SimpleNamespace:
    return SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds), frame_id=frame_id)


@pytest.fixture(scope="session")
def image_message() -> Callable[..., SimpleNamespace]:
    def build(encoding: str, width: int, height: int, data: Any, step: int, is_bigendian: int = 0) -> SimpleNamespace:
        return SimpleNamespace(
            header=header(),
            encoding=encoding,
            width=width,
            height=height,
            data=data,
            step=step,
            is_bigendian=is_bigendian,
        )

    return build


@pytest.fixture(scope="session")
def cloud_message() -> Callable[..., SimpleNamespace]:
    """Builds a PointCloud2 byte by byte from fields (name, datatype, offset, values)."""

    def build(
        *fields: tuple[str, int, int, Any],
        point_step: int | None = None,
        is_bigendian: bool = False,
        height: int = 1,
        row_padding: int = 0,
    ) -> SimpleNamespace:
        count = len(fields[0][3]) if fields else 0
        width = count // height
        point_step = point_step or max((offset + SIZES[kind] for _, kind, offset, _ in fields), default=0)
        row_step = width * point_step + row_padding
        data = bytearray(b"\x5a" * (row_step * height))
        for _, kind, offset, values in fields:
            for index, value in enumerate(values):
                at = (index // width) * row_step + (index % width) * point_step + offset
                struct.pack_into((">" if is_bigendian else "<") + FORMATS[kind], data, at, value)
        return SimpleNamespace(
            header=header("radar"),
            height=height,
            width=width,
            fields=[
                SimpleNamespace(name=name, offset=offset, datatype=kind, count=1) for name, kind, offset, _ in fields
            ],
            is_bigendian=is_bigendian,
            point_step=point_step,
            row_step=row_step,
            data=np.frombuffer(bytes(data), np.uint8),
            is_dense=True,
        )

    return build
