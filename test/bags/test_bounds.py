"""Small bags that unpack to gigabytes are refused with one sentence, in little memory."""

from __future__ import annotations

import resource
import shutil
import sqlite3
import subprocess
import sys
from pathlib import Path

import lz4.frame
import pytest
from bag_bombs import MIB, chunk_record, message_record, packed_zeros, schema_record, write_mcap
from command_line import run_main
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import zstd
from rosbags.typesys import Stores, get_typestore

from radcam_depth_ros.bags import BagError, BagReader, factory
from radcam_depth_ros.bags.unpacking import MOST_BYTES, MOST_EXPANSION, unpack

GIB = 1024 * MIB
ROOT = Path(__file__).parents[2]
READ = """
import resource, sys
from radcam_depth_ros.bags import BagError, BagReader
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    with BagReader(sys.argv[1]) as bag:
        for _ in bag.messages():
            pass
except BagError as error:
    print(error)
else:
    print("read")
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
"""


def read_elsewhere(path: Path) -> tuple[str, int]:
    """What a process of its own says of a bag, and by how many MiB its memory grew."""
    done = subprocess.run(
        [sys.executable, "-c", READ, str(path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=100,
        check=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (6 * GIB, 6 * GIB)),
    )
    sentence, growth = done.stdout.splitlines()
    return sentence, int(growth)


@pytest.mark.parametrize("indexed", [True, False])
@pytest.mark.parametrize(
    ("compression", "real", "declared", "said"),
    [
        ("zstd", GIB, GIB, "beyond the 512 MiB"),
        ("zstd", GIB, 1000, "expand to more than the 1,000 bytes"),
        ("zstd", GIB, 100 * MIB, "expand to more than the 104,857,600 bytes"),
        ("lz4", GIB, 1000, "expand to more than the 1,000 bytes"),
        ("zstd", 0, 2**62, "beyond the 512 MiB"),
        ("lz4", 0, 2**62, "beyond the 512 MiB"),
        ("", 0, 2**62, "beyond the 512 MiB"),
    ],
)
def test_a_chunk_is_bounded_by_what_it_declares_and_by_what_it_is(tmp_path, compression, real, declared, said, indexed):
    chunk = chunk_record(packed_zeros(compression, real) if compression else b"", compression, declared)
    path = write_mcap(tmp_path / "bomb.mcap", [chunk], indexed=indexed)
    sentence, growth_mib = read_elsewhere(path)
    assert said in sentence
    assert str(path) in sentence
    assert growth_mib < declared // MIB + 100 if declared <= MOST_BYTES else growth_mib < 30


def chunk_of_a_message(size: int, times: tuple[int, int]) -> bytes:
    """A chunk with one message of zeros, packed."""
    content = message_record(bytes([0, 1, 0, 0]) + bytes(size), times[0])
    return chunk_record(zstd.compress(content), "zstd", len(content), times)


def test_chunks_of_the_same_time_are_bounded_together(tmp_path, monkeypatch):
    monkeypatch.setattr("radcam_depth_ros.bags.chunks.MOST_OPEN_BYTES", 5 * MIB)
    path = write_mcap(tmp_path / "bomb.mcap", [chunk_of_a_message(MIB, (time, 9)) for time in range(6)])
    with BagReader(path) as bag:
        messages = bag.messages()
        assert [next(messages).log_time_ns for _ in range(4)] == [0, 1, 2, 3]
    path = write_mcap(tmp_path / "bomb.mcap", [chunk_of_a_message(MIB, (5, 9)) for _ in range(6)])
    with BagReader(path) as bag, pytest.raises(BagError, match="chunks of the same time take more than the 5 MiB"):
        next(bag.messages())


def test_chunks_of_different_times_are_held_one_by_one(tmp_path):
    chunks = [chunk_of_a_message(50 * MIB, (time, time)) for time in range(5, 15)]
    sentence, growth_mib = read_elsewhere(write_mcap(tmp_path / "long.mcap", chunks))
    assert sentence == "read"
    assert growth_mib < 250


def test_very_many_empty_messages_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr("radcam_depth_ros.bags.chunks.MOST_OPEN_BYTES", MIB)
    for count, fits in ((3_000, True), (4_000, False)):
        content = message_record(b"") * count
        path = write_mcap(tmp_path / "bomb.mcap", [chunk_record(zstd.compress(content), "zstd", len(content))])
        with BagReader(path) as bag:
            if fits:
                assert sum(1 for _ in bag.messages()) == count
            else:
                with pytest.raises(BagError, match="take more than the 1 MiB"):
                    next(bag.messages())


def test_schemas_of_a_file_without_index_are_bounded(tmp_path):
    packed = zstd.compress(schema_record(definition="#" * (70 * MIB)))
    path = write_mcap(
        tmp_path / "bomb.mcap", [chunk_record(packed, "zstd", len(zstd.decompress(packed)))], indexed=False
    )
    with pytest.raises(BagError, match="schemas and channels take more than 64 MiB"):
        BagReader(path)


def test_an_index_that_names_a_chunk_twice_is_refused(tmp_path):
    chunk = chunk_record(zstd.compress(message_record(b"12345678")), "zstd", len(message_record(b"12345678")))
    path = write_mcap(tmp_path / "twice.mcap", [chunk, chunk])
    content = path.read_bytes()
    first, second = (content.index(chunk), content.rindex(chunk))
    path.write_bytes(content.replace(second.to_bytes(8, "little"), first.to_bytes(8, "little")))
    with BagReader(path) as bag, pytest.raises(BagError, match="chunks of the index overlap"):
        list(bag.messages())


@pytest.mark.parametrize("indexed", [True, False])
@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_a_chunk_within_the_bounds_is_read(tmp_path, compression, indexed):
    content = b"".join(message_record(bytes([0, 1, 0, 0]) + bytes(60), time) for time in (7, 7, 9))
    packed = {"zstd": zstd.compress, "lz4": lz4.frame.compress, "": bytes}[compression](content)
    path = write_mcap(
        tmp_path / "drive.mcap", [chunk_record(packed, compression, len(content), (7, 9))], indexed=indexed
    )
    with BagReader(path) as bag:
        assert [(item.log_time_ns, len(item.raw)) for item in bag.messages()] == [(7, 64), (7, 64), (9, 64)]
        assert [item.log_time_ns for item in bag.messages(start_ns=8)] == [9]
        assert [item.log_time_ns for item in bag.messages(stop_ns=9)] == [7, 7]


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_damaged_content_is_told_from_large_content(compression):
    packed = packed_zeros(compression, 2 * MIB)
    assert unpack(packed, compression) == bytes(2 * MIB)
    assert unpack(packed + packed, compression, 4 * MIB) == bytes(4 * MIB)
    for damaged in (packed[:-5], b"hello" * 9, packed + b"hello"):
        with pytest.raises(ValueError, match=f"no {compression}"):
            unpack(damaged, compression)
    with pytest.raises(ValueError, match="declares 4,194,304 bytes"):
        unpack(packed, compression, 4 * MIB)
    with pytest.raises(BagError, match="more than 64"):
        unpack(packed * 65, compression)


def test_a_refused_bag_ends_a_verb_with_2(tmp_path, monkeypatch, capsys):
    path = write_mcap(tmp_path / "bomb.mcap", [chunk_record(packed_zeros("zstd", GIB), "zstd", 1000)])
    assert run_main(monkeypatch, "inspect", path) == 2
    assert "expand to more than the 1,000 bytes" in " ".join(capsys.readouterr().err.split())


def write_folder(path: Path, storage: StoragePlugin, mode: CompressionMode) -> Path:
    """A rosbag2 folder with three images."""
    store = get_typestore(Stores.ROS2_JAZZY)
    image = factory("sensor_msgs/msg/Image", data=bytes(50_000))
    bag = Writer(path, version=8, storage_plugin=storage)
    if mode != CompressionMode.NONE:
        bag.set_compression(mode, CompressionFormat.ZSTD)
    with bag:
        connection = bag.add_connection("/camera/image_raw", image.__msgtype__, typestore=store)
        for index in range(3):
            bag.write(connection, index, store.serialize_cdr(image, image.__msgtype__))
    return path


def replace_messages(path: Path, statement: str, *values: object) -> None:
    with sqlite3.connect(path) as database:
        database.executescript(statement) if not values else database.execute(statement, values)
    database.close()


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE, CompressionMode.NONE])
def test_folders_within_the_bounds_are_read(tmp_path, storage, mode):
    with BagReader(write_folder(tmp_path / "drive", storage, mode)) as bag:
        assert [len(item.message.data) for item in bag.messages()] == [50_000] * 3


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_compressed_message_is_bounded(tmp_path, storage, monkeypatch):
    packed = packed_zeros("zstd", GIB)
    monkeypatch.setattr("rosbags.rosbag2.writer.zstd.compress", lambda _: packed)
    sentence, growth_mib = read_elsewhere(write_folder(tmp_path / "bomb", storage, CompressionMode.MESSAGE))
    assert "expand to more than 512 MiB" in sentence
    assert growth_mib < 700


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (packed_zeros("zstd", 64 * MIB), f"more than {MOST_EXPANSION} times"),
        (zstd.compress(bytes(64 * MIB)), f"more than {MOST_EXPANSION} times"),
        (zstd.compress(b"12345678") + zstd.compress(bytes(64 * MIB)), f"more than {MOST_EXPANSION} times"),
        (b"\x50\x2a\x4d\x18\x04\x00\x00\x00abcd" + zstd.compress(bytes(64 * MIB)), f"more than {MOST_EXPANSION} times"),
        (zstd.compress(bytes(MIB))[:-3], "no zstd file"),
    ],
)
def test_a_compressed_file_is_bounded_before_it_is_unpacked(tmp_path, content, said, monkeypatch):
    path = write_folder(tmp_path / "bomb", StoragePlugin.SQLITE3, CompressionMode.FILE)
    (file,) = path.glob("*.zstd")
    file.write_bytes(content)
    monkeypatch.setattr("rosbags.rosbag2.reader.shutil.copyfileobj", lambda *_: pytest.fail("it was unpacked"))
    with pytest.raises(BagError, match=said) as caught:
        BagReader(path)
    assert "\n" not in str(caught.value)


def test_a_compressed_file_leaves_half_of_the_disk_free(tmp_path, monkeypatch):
    path = write_folder(tmp_path / "drive", StoragePlugin.SQLITE3, CompressionMode.FILE)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**9, 10**9, 600))
    with pytest.raises(BagError, match="does not fit into half of the free space"):
        BagReader(path)


def test_a_message_of_a_sqlite_bag_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr("radcam_depth_ros.bags.recording.MOST_BYTES", MIB)
    path = write_folder(tmp_path / "drive", StoragePlugin.SQLITE3, CompressionMode.NONE)
    replace_messages(path / "drive.db3", "UPDATE messages SET data = ? WHERE timestamp = 1", bytes(2 * MIB))
    with BagReader(path) as bag:
        messages = bag.messages()
        assert next(messages).log_time_ns == 0
        with pytest.raises(BagError, match=r"a message of .*drive.db3 is beyond the 1 MiB"):
            next(messages)


@pytest.mark.parametrize("change", ["data = 'a text'", "data = 1000000000", "timestamp = -5"])
def test_a_message_of_a_sqlite_bag_that_is_no_bytes_or_has_no_time_is_refused(tmp_path, change):
    path = write_folder(tmp_path / "drive", StoragePlugin.SQLITE3, CompressionMode.NONE)
    replace_messages(path / "drive.db3", f"UPDATE messages SET {change} WHERE timestamp = 1")
    with BagReader(path) as bag, pytest.raises(BagError, match="damaged"):
        list(bag.messages())


@pytest.mark.parametrize(
    "statement",
    [
        """DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,
           data BLOB AS (zeroblob(900000000))); INSERT INTO messages(topic_id, timestamp) VALUES(1, 1)""",
        """DROP TABLE message_definitions; CREATE VIEW Message_Definitions AS WITH RECURSIVE endless(n) AS
           (SELECT 1 UNION ALL SELECT n + 1 FROM endless) SELECT n AS id, 'a/msg/B' AS topic_type, 'ros2msg' AS
           encoding, hex(zeroblob(1000000)) AS encoded_message_definition, '' AS type_description_hash FROM endless""",
        "DROP TABLE topics; CREATE VIRTUAL TABLE topics USING fts5(id, name, type)",
    ],
)
@pytest.mark.parametrize("single_file", [True, False])
def test_tables_that_are_computed_are_refused(tmp_path, statement, single_file):
    path = write_folder(tmp_path / "bomb", StoragePlugin.SQLITE3, CompressionMode.NONE)
    replace_messages(path / "bomb.db3", statement)
    sentence, growth_mib = read_elsewhere(path / "bomb.db3" if single_file else path)
    assert "is computed instead of stored" in sentence
    assert growth_mib < 30
