from __future__ import annotations

from pathlib import Path

import pytest

from radcam_depth_ros.bags import BagError, find_bags


def test_bags_are_found_in_folders_and_named_once(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "metadata.yaml").touch()
    (tmp_path / "a" / "a_0.mcap").touch()
    (tmp_path / "deep" / "deeper").mkdir(parents=True)
    (tmp_path / "deep" / "deeper" / "b.mcap").touch()
    (tmp_path / ".c.mcap.partial").mkdir()
    (tmp_path / ".c.mcap.partial" / "c.mcap").touch()
    (tmp_path / "notes.txt").touch()
    expected = (tmp_path / "a", tmp_path / "deep" / "deeper" / "b.mcap")
    assert find_bags([tmp_path, tmp_path / "a"]) == expected
    for nothing in (tmp_path / "notes.txt", tmp_path / "missing"):
        with pytest.raises(BagError, match="no bag at"):
            find_bags([nothing])
