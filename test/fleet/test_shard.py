from __future__ import annotations

import pytest

from radcam_depth_ros.files import content_of
from radcam_depth_ros.fleet.errors import FleetError
from radcam_depth_ros.fleet.shard import Shard
from radcam_depth_ros.fleet.unit import units_of


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize(("count", "drives"), [(1, 3), (3, 10), (4, 2)])
def test_shards_share_all_drives_however_they_are_counted(first, count, drives):
    shares = [Shard(index, count).take(range(drives)) for index in range(first, first + count)]
    assert sorted(sum(shares, ())) == list(range(drives))
    assert max(map(len, shares)) - min(map(len, shares)) <= 1


@pytest.mark.parametrize("text", ["3/2", "1/0", "-1/2", "1", "a/b", "1/2/3", ""])
def test_a_shard_that_cannot_be_is_refused(text):
    with pytest.raises(FleetError, match="expected a shard"):
        Shard.parse(text)


def test_units_have_plain_and_distinct_names():
    names = [unit.name for unit in units_of(["a/drive.mcap", "b/drive.mcap", "c/mon day\n", "c/mon_day", "d/é.mcap"])]
    assert len(set(names)) == 5
    assert all(name.isascii() and name.replace("-", "").replace("_", "").isalnum() for name in names)
    assert units_of(["here/drive.mcap"])[0].name == units_of(["there/drive.mcap"])[0].name == "drive"


def test_content_is_what_is_inside_and_not_where(tmp_path):
    for place in ("a", "b"):
        (tmp_path / place).mkdir()
        (tmp_path / place / "0.mcap").write_bytes(b"one")
    assert content_of(tmp_path / "a") == content_of(tmp_path / "b")
    (tmp_path / "b" / "0.mcap").write_bytes(b"two")
    assert content_of(tmp_path / "a") != content_of(tmp_path / "b")
    assert content_of(tmp_path / "a" / "0.mcap") != content_of(tmp_path / "a")
