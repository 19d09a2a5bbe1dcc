"""Bags as an attacker would make them, from a good drive of a few frames."""

from __future__ import annotations

import random
import re
import sqlite3
import struct
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from benchmarks import fuzz_messages
from benchmarks.adversary.good_files import INTEGERS, mutated
from benchmarks.fuzz_messages import CAMERA, CAMERA_INFO, IMAGE, RADAR, STATIC, TYPES
from radcam_depth_ros.bags import factory
from radcam_depth_ros.bags.definitions import MessageType, jazzy_typestore
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.messages import encode_depth

FRAMES = 3
_START_NS, _PERIOD_NS = 1_000_000_000_000, 100_000_000
TRUTH = "/ground_truth/depth"
_MCAP, _SQLITE = StoragePlugin.MCAP, StoragePlugin.SQLITE3
OBEYED_NAMES = (
    "x\n    model_file: /evil.pt\n#",
    "[/x]",
    "[red]x[/red]",
    "x\x1b[2J\x1b]0;title\x07",
    "x\r\x00\x7f\x85\u2028\u202e",
    "<script>alert(1)</script>",
    "x: {a: [",
    "'\"`$(reboot)",
)
"""Names that a writer of YAML, HTML or a terminal might obey."""
_NAMES = (*OBEYED_NAMES, "", "/", "a" * 20_000, "/../../etc", "{x}", "%s%n", "\u0301")
_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/PointCloud2", "x", "", "a/b/c/d", "std_msgs/msg/Nothing", "\x1b[2J")
_DEFINITIONS = (
    *(
        "",
        "uint8 x",
        "string x\n" * 2000,
        "a/b x",
        "uint8[4294967295] data",
        "float64[99999999999] x",
        "int32 X=1\n" * 500,
    ),
    *(
        "std_msgs/Header header\nuint8[] data",
        "sensor_msgs/Image x",
        "=" * 80 + "\nMSG: a/b\na/b x",
        "\x00",
        "# " + "x" * 10**5,
    ),
    *(
        "=" * 80 + "\nIDL: a/b\nmodule a {" * 300,
        "string<=4 x",
        "uint8[<=3] x 'a'",
        "wstring x",
        "uint8 " + "x" * 10**4,
        "[" * 5000,
    ),
)
_BOMB_BYTES = 2**31


@dataclass(frozen=True)
class Written:
    """A message as it is stored: topic, type, time (nanoseconds), bytes."""

    topic: str
    type_name: str
    time_ns: int
    raw: bytes


def good_messages() -> tuple[Written, ...]:
    """A drive of a few frames, with exact depth."""

    def written(topic: str, message: Any, time_ns: int) -> Written:
        type_name = TYPES.get(topic, TYPES[IMAGE])
        return Written(topic, type_name, time_ns, bytes(MessageType.jazzy(type_name).serialise(message, topic)))

    found = [written(STATIC, fuzz_messages.good(STATIC, _START_NS), _START_NS)]
    depth = np.full((CAMERA.height, CAMERA.width), 10.0, np.float32)
    for index in range(FRAMES):
        stamp_ns = _START_NS + (index + 1) * _PERIOD_NS
        found += [
            written(topic, fuzz_messages.good(topic, stamp_ns), stamp_ns) for topic in (CAMERA_INFO, RADAR, IMAGE)
        ]
        found.append(written(TRUTH, encode_depth(factory, depth, stamp_ns, "camera"), stamp_ns))
    return tuple(found)


def write_bag(
    folder: Path, messages: tuple[Written, ...], plugin: Any, definition: str = "", compress: str = ""
) -> None:
    """Writes a rosbag2 folder by rosbags' own writer, which takes any names.

    Args:
        folder: That is not there yet.
        messages: What it holds.
        plugin: Of the storage.
        definition: In place of those of the images' types.
        compress: `message`, `file` or `storage`; empty for none.
    """
    writer = Writer(folder, version=9, storage_plugin=plugin)
    if compress:
        writer.set_compression(CompressionMode[compress.upper()], CompressionFormat.ZSTD)
    with writer:
        connections: dict[tuple[str, str], Any] = {}
        for message in messages:
            key = (message.topic, message.type_name)
            if key not in connections:
                is_known = message.type_name in jazzy_typestore().fielddefs
                if is_known and not (definition and message.type_name == TYPES[IMAGE]):
                    options = {"typestore": jazzy_typestore()}
                else:
                    options = {"msgdef": definition, "rihs01": "RIHS01_" + "0" * 64}
                connections[key] = writer.add_connection(*key, **options)
            writer.write(connections[key], message.time_ns, message.raw)


def hostile_bag(rng: random.Random, good: tuple[Written, ...], folder: Path) -> tuple[str, Path]:
    """Writes a hostile bag into a folder; returns what was done and the bag's path."""
    return rng.choice(_MAKERS)(rng, good, folder / "bag")


def _storage(folder: Path) -> Path:
    return next(path for path in folder.iterdir() if path.suffix != ".yaml")


def _any_storage(rng: random.Random, folder: Path) -> tuple[str, Path]:
    """What a storage is called, and the bag: the folder, or the file within."""
    file = _storage(folder)
    is_alone = file.suffix in (".mcap", ".db3") and rng.random() < 0.5
    return file.suffix[1:], file if is_alone else folder


def _changed_bytes(rng: random.Random, good: tuple[Written, ...], folder: Path) -> tuple[str, Path]:
    plugin = rng.choice((_MCAP, _SQLITE))
    compress = rng.choice(("", "", "message", "file" if plugin is _SQLITE else "storage"))
    write_bag(folder, good, plugin, compress=compress)
    kind, path = _any_storage(rng, folder)
    file = _storage(folder)
    content = file.read_bytes()
    # Half of the changes are where a storage describes itself: at its end (MCAP), at its beginning (SQLite).
    start = max(len(content) - 4000, 0) if plugin is _MCAP and rng.random() < 0.5 else 0
    how, changed = mutated(rng, content, start)
    file.write_bytes(changed)
    return f"{kind} {compress}: {how}", path


def _records(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, place of the content and length of each record of an MCAP file."""
    place = 8
    while place + 9 <= len(content) - 8:
        opcode, length = struct.unpack_from("<BQ", content, place)
        yield opcode, place + 9, length
        place += 9 + length


def _lying_sizes(rng: random.Random, good: tuple[Written, ...], folder: Path) -> tuple[str, Path]:
    """Lengths, offsets and counts of an MCAP file's records."""
    write_bag(folder, good, _MCAP, compress=rng.choice(("", "storage")))
    file = _storage(folder)
    content = bytearray(file.read_bytes())
    records = list(_records(bytes(content)))
    opcodes = sorted({opcode for opcode, _, _ in records})
    opcode = rng.choice(opcodes)
    for _ in range(rng.choice((1, 1, 2))):
        _, place, length = rng.choice([record for record in records if record[0] == opcode])
        at = place - 8 if rng.random() < 0.3 else place + rng.randrange(0, min(length, 64) + 1)
        size = rng.choice((2, 4, 8))
        number = rng.choice((*INTEGERS, len(content), len(content) - at, rng.getrandbits(40)))
        content[at : at + size] = number.to_bytes(8, "little")[:size]
    file.write_bytes(content)
    return f"mcap: record {opcode:#04x}", rng.choice((file, folder))


def _bomb(rng: random.Random, good: tuple[Written, ...], folder: Path) -> tuple[str, Path]:
    """A compressed chunk that becomes gigabytes, of which its header tells the size or a small one."""
    write_bag(folder, good, _MCAP, compress="storage")
    file = _storage(folder)
    content = file.read_bytes()
    place, length = next((place, length) for opcode, place, length in _records(content) if opcode == 0x06)
    first, last, _, _ = struct.unpack_from("<QQQI", content, place)
    size = rng.choice((_BOMB_BYTES, 1000, 0, 2**63))
    chunk = struct.pack("<QQQII4sQ", first, last, size, 0, 4, b"zstd", len(_zeros())) + _zeros()
    rest = content[place + length :] if rng.random() < 0.5 else b""
    file.write_bytes(content[: place - 8] + struct.pack("<Q", len(chunk)) + chunk + rest)
    return f"mcap: bomb that tells {size} bytes", rng.choice((file, folder))


def _zeros() -> bytes:
    """A frame of zstd that holds 2 GiB of zeros: blocks of one byte that is repeated."""
    blocks = [struct.pack("<I", (131_072 << 3) | 2 | (number == _BOMB_BYTES // 131_072 - 1))[:3] + b"\0"
              for number in range(_BOMB_BYTES // 131_072)]  # fmt: skip
    return b"\x28\xb5\x2f\xfd\x00\x38" + b"".join(blocks)


def _renamed(rng: random.Random, good: tuple[Written, ...], folder: Path) -> tuple[str, Path]:
    """Hostile names of topics, and of frames and fields within the messages."""
    name = rng.choice(_NAMES)
    topics = {topic: f"{topic}{name}" for topic in {message.topic for message in good} if rng.random() < 0.7}
    messages = []
    for message in good:
        raw = message.raw
        with suppress(RadcamDepthError):
            content: Any = fuzz_messages.thawed(MessageType.jazzy(message.type_name).deserialise(raw, message.topic))
            for stamped in getattr(content, "transforms", [content]):
                if rng.random() < 0.5:
                    stamped.header.frame_id += name
            for field in getattr(content, "fields", []):
                field.name += name if rng.random() < 0.3 else ""
            raw = bytes(MessageType.jazzy(message.type_name).serialise(content, message.topic))
        messages.append(Written(topics.get(message.topic, message.topic), message.type_name, message.time_ns, raw))
    write_bag(folder, tuple(messages), rng.choice((_MCAP, _SQLITE)))
    kind, path = _any_storage(rng, folder)
    return f"{kind}: name {name[:12]!r}", path


def _retyped(rng: random.Random, good: tuple[Written, ...], folder: Path) -> tuple[str, Path]:
    """Topics of other types than their messages are, and definitions that nobody should follow."""
    definition = rng.choice(_DEFINITIONS) if rng.random() < 0.6 else "uint8 x"
    wrong = {topic: rng.choice(_TYPES) for topic in {message.topic for message in good} if rng.random() < 0.3}
    messages = tuple(
        Written(message.topic, wrong.get(message.topic, message.type_name), message.time_ns, message.raw)
        for message in good
    )
    write_bag(folder, messages, rng.choice((_MCAP, _SQLITE)), definition if rng.random() < 0.7 else "")
    kind, path = _any_storage(rng, folder)
    return f"{kind}: types and definitions", path


def _hostile_messages(rng: random.Random, good: tuple[Written, ...], folder: Path) -> tuple[str, Path]:
    """Messages as `fuzz_messages` makes them, among good ones, at any time."""
    messages = list(good)
    for _ in range(rng.randint(1, 8)):
        time_ns = _START_NS + rng.randrange(5) * _PERIOD_NS
        for sent in fuzz_messages.bad(rng, time_ns):
            type_name = TYPES[sent.topic]
            if sent.kind.startswith("CompressedImage"):
                type_name = "sensor_msgs/msg/CompressedImage"
            elif sent.kind == "RadarScan":
                type_name = "radar_msgs/msg/RadarScan"
            with suppress(RadcamDepthError):  # what cannot be written reaches nobody
                raw = bytes(MessageType.jazzy(type_name).serialise(sent.message, sent.topic))
                if rng.random() < 0.2:
                    raw = mutated(rng, raw)[1]
                messages.append(Written(sent.topic, type_name, rng.choice((time_ns, time_ns, 0, 2**62)), raw))
    rng.shuffle(messages)
    write_bag(folder, tuple(messages), rng.choice((_MCAP, _SQLITE)))
    kind, path = _any_storage(rng, folder)
    return f"{kind}: messages", path


def _metadata(rng: random.Random, good: tuple[Written, ...], folder: Path) -> tuple[str, Path]:
    """A metadata.yaml that lies or is hard to read."""
    plugin = rng.choice((_MCAP, _SQLITE))
    write_bag(folder, good, plugin)
    file = folder / "metadata.yaml"
    text, name = file.read_text(encoding="utf-8"), _storage(folder).name
    deep = 10 ** rng.randint(2, 5)
    places = ("../../home/bystander.txt", "/dev/zero", "/etc/passwd", "..", "", "\\0")
    modes, versions = ("file", "message", "x"), ("1", "99", "[]", "!!python/object:os.system x")
    ends = ("[" * deep, "a: &a [*a, *a]\n", "- " * deep, "\x1b[2J", "a: 2001-99-99\n", "{" * deep)
    changes: tuple[Callable[[], str], ...] = (
        lambda: text.replace(name, rng.choice(places)),
        lambda: re.sub("(compression_format:) ''", r"\1 zstd", text.replace("mode: ''", f"mode: {rng.choice(modes)}")),
        lambda: text.replace("message_count: ", f"message_count: {rng.choice(('-', '9' * 5000, 'x'))}"),
        lambda: text.replace("nanoseconds: ", f"nanoseconds: {rng.choice(('-', '9' * 30, '[]'))}"),
        lambda: text.replace("version: 9", f"version: {rng.choice(versions)}"),
        lambda: re.sub("(name|type): .*", lambda found: f"{found[1]}: {rng.choice(('3', '[a]', '{}', '~'))}", text),
        lambda: text + rng.choice(ends),
        lambda: mutated(rng, text.encode())[1].decode("utf-8", errors="replace"),
    )
    number = rng.randrange(len(changes))
    file.write_text(changes[number](), encoding="utf-8")
    return f"metadata: change {number}", folder


_STATEMENTS = (
    "UPDATE topics SET name = name || char(10, 27) || '[2J'",
    "UPDATE topics SET type = 'sensor_msgs/msg/Image'",
    "UPDATE topics SET offered_qos_profiles = '- &a [*a]'",
    "UPDATE topics SET id = NULL",
    "UPDATE topics SET name = 3, type = x'00ff', serialization_format = NULL",
    "UPDATE messages SET timestamp = 'x'",
    "UPDATE messages SET timestamp = -1",
    "UPDATE messages SET timestamp = 9e99",
    "UPDATE messages SET data = 'text'",
    "UPDATE messages SET data = NULL",
    "UPDATE messages SET data = zeroblob(100000000) WHERE id = 2",
    "UPDATE messages SET topic_id = 99",
    "UPDATE message_definitions SET encoded_message_definition = 5",
    "UPDATE message_definitions SET encoding = 'ros2idl'",
    "DROP TABLE topics",
    "DROP TABLE messages; CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n "
    "LIMIT 3000000) SELECT id, 1 AS topic_id, id AS timestamp, x'00' AS data FROM n",
    "DROP TABLE messages; CREATE TABLE messages (id, topic_id, timestamp, data GENERATED ALWAYS AS (zeroblob(id)))",
    "DROP TABLE schema; CREATE TABLE schema (schema_version, ros_distro); INSERT INTO schema VALUES ('x', x'ff')",
    "PRAGMA journal_mode = WAL",
    "PRAGMA user_version = 99",
    "CREATE TRIGGER t AFTER INSERT ON topics BEGIN SELECT load_extension('x'); END",
)


def _sql(rng: random.Random, good: tuple[Written, ...], folder: Path) -> tuple[str, Path]:
    """A database whose tables hold what they should not."""
    write_bag(folder, good, _SQLITE)
    numbers = [rng.randrange(len(_STATEMENTS)) for _ in range(rng.choice((1, 1, 2)))]
    with closing(sqlite3.connect(_storage(folder))) as database:
        for number in numbers:
            with suppress(sqlite3.Error):
                database.executescript(_STATEMENTS[number])
        database.commit()
    return f"db3: SQL {', '.join(map(str, numbers))}", rng.choice((folder, _storage(folder)))


_MAKERS: tuple[Callable[[random.Random, tuple[Written, ...], Path], tuple[str, Path]], ...] = (
    *(_changed_bytes, _changed_bytes, _changed_bytes, _lying_sizes, _lying_sizes, _renamed, _renamed, _retyped),
    *(_retyped, _hostile_messages, _hostile_messages, _hostile_messages, _metadata, _metadata, _sql, _sql),
    # Rare: each is the same.
    *(lambda rng, good, folder: (_bomb if rng.random() < 0.2 else _sql)(rng, good, folder),),
)
