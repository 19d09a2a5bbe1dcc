from __future__ import annotations

import errno
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from disks import full_disk
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from radcam_depth_ros.bags import BagError, BagReader, BagWriter, factory
from radcam_depth_ros.bags.storage import McapBagWriter

SECOND = 1_000_000_000
PLACES = ["drive", "drive.mcap"]


def image(index: int, size: int = 30):
    stamp = factory("builtin_interfaces/msg/Time", sec=index)
    header = factory("std_msgs/msg/Header", stamp=stamp, frame_id="camera")
    data = np.random.default_rng(index).integers(0, 256, size, dtype=np.uint8)
    return factory("sensor_msgs/msg/Image", header=header, height=1, width=size, encoding="mono8", step=size, data=data)


def write_drive(path, count=5, size=30, **options):
    with BagWriter(path, **options) as bag:
        bag.write("/tf_static", factory("tf2_msgs/msg/TFMessage"), 0)
        for index in range(count):
            bag.write("/camera/image_raw", image(index, size), index * SECOND)
            bag.write("/radar/points", factory("sensor_msgs/msg/PointCloud2"), index * SECOND + 5)
    return path


def names_in(folder):
    return sorted(entry.name for entry in folder.iterdir())


@pytest.mark.parametrize("size", [30, 2_000_000])
@pytest.mark.parametrize("compress", [True, False])
@pytest.mark.parametrize("place", PLACES)
def test_what_is_written_is_read(tmp_path, place, compress, size):
    path = write_drive(tmp_path / "deep" / place, size=size, compress=compress)
    with BagReader(path) as bag:
        assert [(topic.name, topic.type_name, topic.count, topic.latched) for topic in bag.topics] == [
            ("/camera/image_raw", "sensor_msgs/msg/Image", 5, False),
            ("/radar/points", "sensor_msgs/msg/PointCloud2", 5, False),
            ("/tf_static", "tf2_msgs/msg/TFMessage", 1, True),
        ]
        assert (bag.count(), bag.count(["/radar/points"]), bag.count([])) == (11, 5, 0)
        assert (bag.start_ns, bag.duration_ns) == (0, 4 * SECOND + 5)
        assert [message.log_time_ns for message in bag.messages(["/radar/points"])] == [
            index * SECOND + 5 for index in range(5)
        ]
        assert list(bag.messages([])) == []
        times = [message.log_time_ns for message in bag.messages()]
        assert len(times) == 11
        assert times == sorted(times)
        for index, item in enumerate(bag.messages(["/camera/image_raw"])):
            assert item.type_name == "sensor_msgs/msg/Image"
            assert item.message.header.frame_id == "camera"
            np.testing.assert_array_equal(item.message.data, image(index, size).data)
    assert names_in(path.parent) == [place]


def test_a_folder_is_what_rosbag2_expects(tmp_path):
    path = write_drive(tmp_path / "drive")
    assert names_in(path) == ["drive.mcap", "metadata.yaml"]
    information = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (information["storage_identifier"], information["relative_file_paths"]) == ("mcap", ["drive.mcap"])
    topics = {
        entry["topic_metadata"]["name"]: entry["topic_metadata"] for entry in information["topics_with_message_count"]
    }
    (profile,) = topics["/tf_static"]["offered_qos_profiles"]
    assert (profile["durability"], profile["reliability"], profile["history"]) == (
        "transient_local",
        "reliable",
        "keep_last",
    )
    assert profile["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    assert topics["/camera/image_raw"]["offered_qos_profiles"] == []


@pytest.mark.parametrize("place", PLACES)
def test_latched_topics_are_recorded_as_such(tmp_path, place):
    path = write_drive(tmp_path / place, latched=("/tf_static", "/radar/points"))
    with Reader(path) as bag:
        profiles = {connection.topic: connection.ext.offered_qos_profiles for connection in bag.connections}
    assert profiles["/camera/image_raw"] == []
    for topic in ("/tf_static", "/radar/points"):
        (profile,) = profiles[topic]
        assert profile.durability == QosDurability.TRANSIENT_LOCAL
        assert profile.reliability == QosReliability.RELIABLE
    with BagReader(path) as bag:
        assert [topic.name for topic in bag.topics if topic.latched] == ["/radar/points", "/tf_static"]
        assert bag.count(["/tf_static"]) == len(list(bag.messages(["/tf_static"])))


def test_the_same_messages_give_the_same_bytes(tmp_path):
    first, second = (write_drive(tmp_path / name / "drive.mcap") for name in "ab")
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize("place", PLACES)
def test_an_exception_leaves_nothing(tmp_path, place):
    def interrupted():
        with BagWriter(tmp_path / place) as bag:
            bag.write("/camera/image_raw", image(0), 0)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert names_in(tmp_path) == []


@pytest.mark.parametrize("place", PLACES)
def test_a_bag_is_overwritten_only_on_request_and_only_when_complete(tmp_path, place):
    path = write_drive(tmp_path / place, count=2)
    with pytest.raises(BagError, match="exists already"):
        BagWriter(path)
    with pytest.raises(ZeroDivisionError), BagWriter(path, overwrite=True):
        raise ZeroDivisionError
    with BagReader(path) as bag:
        assert bag.count(["/camera/image_raw"]) == 2
    write_drive(path, count=3, overwrite=True)
    with BagReader(path) as bag:
        assert bag.count(["/camera/image_raw"]) == 3
    assert names_in(tmp_path) == [place]


def test_what_is_no_bag_is_never_overwritten(tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "holiday.jpg").touch()
    (tmp_path / "photos.mcap").mkdir()
    (tmp_path / "letter").touch()
    for name in ("photos", "photos.mcap", "letter"):
        with pytest.raises(BagError, match="not overwritten"):
            BagWriter(tmp_path / name, overwrite=True)


@pytest.mark.parametrize("place", PLACES)
def test_a_recording_of_somebody_else_is_never_overwritten(tmp_path, place):
    folder = tmp_path / "recorded"
    with Writer(folder, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP) as writer:
        store = get_typestore(Stores.ROS2_JAZZY)
        topic = writer.add_connection("/radar/points", "sensor_msgs/msg/PointCloud2", typestore=store)
        message = factory("sensor_msgs/msg/PointCloud2")
        writer.write(topic, 0, store.serialize_cdr(message, "sensor_msgs/msg/PointCloud2"))
    path = tmp_path / place
    shutil.copytree(folder, path) if place == "drive" else shutil.copy(next(folder.glob("*.mcap")), path)
    with pytest.raises(BagError, match="no bag that radcam-depth wrote"):
        BagWriter(path, overwrite=True)


@pytest.mark.parametrize("other", ["notes.txt", "recording.mcap", "pictures/1.png"])
def test_other_files_in_a_bag_of_our_own_are_never_lost(tmp_path, other):
    path = write_drive(tmp_path / "drive")
    file = path / other
    file.parent.mkdir(exist_ok=True)
    file.write_text("somebody's")
    with pytest.raises(BagError, match="other files"):
        BagWriter(path, overwrite=True)
    assert file.read_text() == "somebody's"


@pytest.mark.parametrize("place", PLACES)
def test_a_bag_comes_back_when_another_cannot_take_its_place(tmp_path, place, monkeypatch):
    path = write_drive(tmp_path / place, count=2)

    def fail(source, target):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", fail)
        with pytest.raises(BagError, match="cannot finish"):
            write_drive(path, count=3, overwrite=True)
    with BagReader(path) as bag:
        assert bag.count(["/camera/image_raw"]) == 2
    assert names_in(tmp_path) == [place]


@pytest.mark.parametrize("place", PLACES)
def test_nothing_stays_when_the_file_cannot_even_be_closed(tmp_path, place, monkeypatch):
    abort = McapBagWriter.abort

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def closed_but_full(writer):
        abort(writer)
        full()

    monkeypatch.setattr(McapBagWriter, "write", full)
    monkeypatch.setattr(McapBagWriter, "abort", closed_but_full)
    with pytest.raises(BagError, match=r"cannot write to the bag .*No space left"):
        write_drive(tmp_path / place)
    assert names_in(tmp_path) == []


def test_a_file_that_is_cut_short_is_never_overwritten(tmp_path):
    path = write_drive(tmp_path / "drive.mcap")
    content = path.read_bytes()
    for length in (0, 5, 40, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:length])
        with pytest.raises(BagError, match="no bag that radcam-depth wrote"):
            BagWriter(path, overwrite=True)


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match="cannot write a bag"), BagWriter(tmp_path / "file" / "drive"):
        pass


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(("size", "room"), [(30, 100), (30, 3000), (400_000, 1_200_000), (2_000_000, 100)])
def test_a_disk_that_is_full_to_the_last_byte_keeps_nothing(tmp_path, place, size, room):
    # What the writer still has in its buffer cannot be written either when the file is closed.
    with full_disk(room), pytest.raises(BagError, match=r"cannot (finish|write to) the bag"):
        write_drive(tmp_path / place, size=size, compress=False)
    assert names_in(tmp_path) == []


def test_writing_refuses_what_it_cannot_write(tmp_path):
    writer = BagWriter(tmp_path / "drive")
    with pytest.raises(BagError, match="inside its `with` block"):
        writer.write("/camera/image_raw", image(0), 0)
    with writer as bag:
        with pytest.raises(BagError, match="does not say its type"):
            bag.write("/camera/image_raw", object(), 0)
        broken = image(0)
        broken.width = "wide"
        with pytest.raises(BagError, match=r"does not fit sensor_msgs/msg/Image"):
            bag.write("/camera/image_raw", broken, 0)
        bag.write_raw("/camera/image_raw", b"\x00\x01\x00\x00", 0, "sensor_msgs/msg/Image")
    with BagReader(tmp_path / "drive") as bag, pytest.raises(BagError, match=r"/camera/image_raw is no sensor_msgs"):
        _ = next(bag.messages()).message


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("kept", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_truncated_bag_is_refused_with_one_sentence(tmp_path, place, kept):
    path = write_drive(tmp_path / place, size=400_000)
    file = path / "drive.mcap" if path.is_dir() else path
    file.write_bytes(file.read_bytes()[: int(file.stat().st_size * kept)])
    with pytest.raises(BagError, match="truncated, damaged or no ROS 2 bag") as caught:
        BagReader(path)
    assert "\n" not in str(caught.value)


def test_damage_in_the_middle_is_found_while_reading(tmp_path):
    path = write_drive(tmp_path / "drive.mcap", count=12, size=400_000)
    content = bytearray(path.read_bytes())
    start, stop = int(len(content) * 0.3), int(len(content) * 0.7)
    content[start:stop] = bytes(stop - start)
    path.write_bytes(content)
    with BagReader(path) as bag:
        messages = bag.messages()
        next(messages)
        with pytest.raises(BagError, match="truncated, damaged"):
            list(messages)


def test_a_truncated_sqlite_bag_is_refused(tmp_path):
    path = write_sqlite(tmp_path / "drive", [image(index, 20_000) for index in range(20)])
    with BagReader(path) as bag:
        assert [item.message.header.stamp.sec for item in bag.messages()] == list(range(20))
    with BagReader(path / "drive.db3") as bag:
        assert bag.count() == 20
    file = path / "drive.db3"
    file.write_bytes(file.read_bytes()[:100_000])

    def read_all():
        with BagReader(path) as bag:
            return [item.message for item in bag.messages()]

    with pytest.raises(BagError, match="truncated, damaged"):
        read_all()


def write_sqlite(path, messages):
    typestore = get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as bag:
        connection = bag.add_connection("/camera/image_raw", messages[0].__msgtype__, typestore=typestore)
        for index, message in enumerate(messages):
            bag.write(connection, index, typestore.serialize_cdr(message, message.__msgtype__))
    return path


def test_what_is_no_bag_is_refused(tmp_path):
    drive = write_drive(tmp_path / "drive")
    (drive / "metadata.yaml").unlink()
    (tmp_path / "empty").mkdir()
    for name, content in {"old.bag": b"#ROSBAG V2.0", "notes.txt": b"hello", "foreign.mcap": b"hello" * 20}.items():
        (tmp_path / name).write_bytes(content)
    broken = shutil.copytree(drive, tmp_path / "broken")
    (broken / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    for name, sentence in {
        "missing": "there is no bag at",
        "drive": r"no metadata.yaml; give the file .*drive.mcap itself",
        "empty": "no metadata.yaml; give a rosbag2 folder",
        "old.bag": "ROS 1 bag; convert",
        "notes.txt": "is no bag; expected",
        "foreign.mcap": "no ROS 2 bag",
        "broken": "no ROS 2 bag",
    }.items():
        with pytest.raises(BagError, match=sentence):
            BagReader(tmp_path / name)
    with BagReader(drive / "drive.mcap") as bag:  # needs no metadata.yaml
        assert bag.count() == 11


@pytest.mark.parametrize("key", ["name", "type", "message_count", "nanoseconds", "nanoseconds_since_epoch"])
@pytest.mark.parametrize("value", ["[a]", "{}", "~", "2001-01-01"])
def test_metadata_of_wrong_types_is_refused(key, value, tmp_path):
    path = write_drive(tmp_path / "drive")
    metadata = path / "metadata.yaml"
    metadata.write_text(re.sub(rf"\b{key}: .*", f"{key}: {value}", metadata.read_text()))
    with pytest.raises(BagError, match="truncated, damaged or no ROS 2 bag"):
        BagReader(path)


def test_an_unknown_topic_is_refused(tmp_path):
    with BagReader(write_drive(tmp_path / "drive")) as bag:
        with pytest.raises(BagError, match=r"no topic /radar/point; it has /radar/points"):
            bag.messages(["/radar/point"])
        with pytest.raises(BagError, match="no topic /odom"):
            bag.count(["/odom"])


def test_an_empty_bag_is_a_bag(tmp_path):
    with BagWriter(tmp_path / "drive"):
        pass
    with BagReader(tmp_path / "drive") as bag:
        assert (bag.topics, bag.start_ns, bag.duration_ns, list(bag.messages())) == ((), 0, 0, [])


def test_types_that_only_the_bag_defines_are_read_and_copied(tmp_path):
    name = "acme_msgs/msg/Detection"
    definition = "std_msgs/Header header\nfloat32 range\nfloat32[] spectrum\n"
    typestore = get_typestore(Stores.ROS2_JAZZY)
    typestore.register(get_types_from_msg(definition, name))
    message = typestore.types[name](factory("std_msgs/msg/Header", frame_id="radar"), 7.5, np.ones(3, np.float32))
    with Writer(tmp_path / "acme", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/detections", name, typestore=typestore)
        bag.write(connection, 5, typestore.serialize_cdr(message, name))
    with BagReader(tmp_path / "acme") as source, BagWriter(tmp_path / "copy.mcap") as copy:
        for item in source.messages():
            copy.copy(item)
            copy.copy(item, topic="/renamed")
    with BagReader(tmp_path / "copy.mcap") as bag:
        items = list(bag.messages())
        assert sorted(item.topic for item in items) == ["/detections", "/renamed"]
        for item in items:
            assert (item.log_time_ns, item.type_name, item.message.range) == (5, name, 7.5)
            assert item.message.spectrum.tolist() == [1.0, 1.0, 1.0]


def test_copies_keep_the_quality_of_service(tmp_path):
    write_drive(tmp_path / "drive", latched=("/radar/points",))
    with BagReader(tmp_path / "drive") as source, BagWriter(tmp_path / "copy", latched=()) as copy:
        for item in source.messages():
            copy.copy(item)
    with Reader(tmp_path / "copy") as bag:
        latched = [connection.topic for connection in bag.connections if connection.ext.offered_qos_profiles]
    assert latched == ["/radar/points"]


def test_the_real_drive_is_read(astyx_val):
    with BagReader(astyx_val) as folder:
        assert folder.count(["/radar_front/points"]) == 16
        (file,) = astyx_val.glob("*.mcap")
        with BagReader(file) as single:
            assert single.topics == folder.topics
            assert [item.raw for item in single.messages()] == [item.raw for item in folder.messages()]
