from __future__ import annotations

from pathlib import Path

import pytest

from radcam_depth_ros.files import FileError, partial_folder, require_apart, whole, write_text


def test_a_file_appears_whole(tmp_path: Path) -> None:
    write_text(tmp_path / "new" / "a.txt", "ä")
    assert (tmp_path / "new" / "a.txt").read_text(encoding="utf-8") == "ä"
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.txt"]


def test_what_was_there_stays_when_writing_fails(tmp_path: Path) -> None:
    write_text(tmp_path / "a.txt", "old")

    def fail() -> None:
        with whole(tmp_path / "a.txt") as temporary:
            temporary.write_text("new")
            raise ValueError("half way")

    with pytest.raises(ValueError, match="half way"):
        fail()
    assert (tmp_path / "a.txt").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    write_text(tmp_path / "file", "")
    with pytest.raises(FileError, match=r"cannot write .*file/a.txt"):
        write_text(tmp_path / "file" / "a.txt", "x")


def test_a_partial_folder_goes_and_takes_what_killed_processes_left(tmp_path: Path) -> None:
    left, of_another = tmp_path / ".a.partial-00000000", tmp_path / ".ab.partial-00000000"
    for folder in (left / "bag", of_another):
        folder.mkdir(parents=True)
    with partial_folder(tmp_path / "a") as in_use:
        assert in_use.is_dir()
        assert not left.exists()
        with partial_folder(tmp_path / "a") as second:
            assert second != in_use
        assert in_use.is_dir()
    assert [path.name for path in tmp_path.iterdir()] == [of_another.name]


def test_what_is_read_is_not_written_to_by_any_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    bag = tmp_path / "drives" / "bag"
    bag.mkdir(parents=True)
    (bag / "metadata.yaml").touch()
    file = tmp_path / "drives" / "one.mcap"
    file.touch()
    (tmp_path / "link").symlink_to(bag)
    (tmp_path / "hard.mcap").hardlink_to(file)
    (bag / "0.mcap").touch()
    (tmp_path / "within.mcap").hardlink_to(bag / "0.mcap")
    for written, read in (
        (bag, bag),
        ("drives/bag", bag),
        ("drives/../drives/bag/", bag),
        ("link", bag),
        (bag, "link"),
        (bag / "depth.mcap", bag),
        ("link/pictures", bag),
        ("drives", bag),
        ("hard.mcap", file),
        (file, "hard.mcap"),
        ("within.mcap", bag),
    ):
        with pytest.raises(FileError, match=r"would be written to, but .* is read"):
            require_apart([None, written], [None, read])
    require_apart(["drives/figures.json", "out"], ["drives", file, tmp_path / "missing", None])
