"""What is wrong with a data set is said in a sentence; the other scenes go on."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run_main
from disks import full_disk

from radcam_depth_ros.bags import find_bags
from radcam_depth_ros.datasets.clouds import read_floats, read_pcd
from radcam_depth_ros.datasets.errors import DatasetError
from radcam_depth_ros.datasets.layout import NUSCENES_RADAR
from radcam_depth_ros.datasets.pcd_file import pcd_file
from radcam_depth_ros.datasets.rows import read_rows
from radcam_depth_ros.datasets.splits import SPLITS, scenes_of, split_of

VERSION = "v1.0-mini"


@pytest.fixture
def run(dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Any:
    """Imports the data set; gives back exit code, names of the bags, and what was said, as one line."""

    def imported(*options: str) -> tuple[int, list[str], str]:
        out = tmp_path / "out"
        code = run_main(monkeypatch, "import", "nuscenes", dataset, out, "--version", VERSION, *options)
        captured = capfd.readouterr()
        names = sorted(path.name for path in out.iterdir()) if out.is_dir() else []
        return code, names, " ".join((captured.out + captured.err).split())

    return imported


def first(dataset: Path, pattern: str) -> Path:
    return sorted(dataset.glob(pattern))[0]


def test_all_scenes_come_and_are_kept(run: Any, dataset: Path, tmp_path: Path) -> None:
    code, names, _ = run()
    assert (code, names) == (0, ["scene-0001.mcap", "scene-0002.mcap", "scene-0003.mcap"])
    (tmp_path / "out" / "scene-0002.mcap").unlink()
    first(dataset, "samples/CAM_FRONT/scene-0001*").unlink()  # not looked at again
    code, names, said = run()
    assert (code, len(names)) == (0, 3)
    assert "2 of them were there" in said
    assert len(find_bags([tmp_path / "out"])) == 3


def test_other_options_do_not_mix_with_bags_that_are_there(run: Any) -> None:
    run("--scenes", "scene-0001")
    code, _, said = run("--images", "keyframes", "--scenes", "scene-0001")
    assert code == 2
    assert "images=all" in said
    assert run("--images", "keyframes", "--scenes", "scene-0001", "--overwrite")[0] == 0


def test_a_bag_that_is_damaged_is_told_and_the_others_come(run: Any, tmp_path: Path) -> None:
    bag = tmp_path / "out" / "scene-0002.mcap"
    bag.parent.mkdir()
    bag.write_bytes(b"half of a bag")
    code, names, said = run()
    assert (code, names) == (3, ["scene-0001.mcap", "scene-0002.mcap", "scene-0003.mcap"])
    assert "remove it" in said
    bag.unlink()
    assert run()[0] == 0


@pytest.mark.slow
def test_several_processes_do_the_same(run: Any) -> None:
    assert run("--jobs", "2")[:2] == (0, ["scene-0001.mcap", "scene-0002.mcap", "scene-0003.mcap"])


def damage_image(dataset: Path) -> str:
    first(dataset, "samples/CAM_FRONT/scene-0002*").unlink()
    return "samples/CAM_FRONT/scene-0002"


def damage_sweep(dataset: Path) -> str:
    first(dataset, "sweeps/RADAR_FRONT/scene-0002*").unlink()
    return "sweeps/RADAR_FRONT/scene-0002"


def cut_image(dataset: Path) -> str:
    path = first(dataset, "samples/CAM_FRONT/scene-0002*")
    path.write_bytes(path.read_bytes()[:-30])
    return "a whole JPEG"


def empty_image(dataset: Path) -> str:
    first(dataset, "sweeps/CAM_FRONT/scene-0002*").write_bytes(b"")
    return "a whole JPEG"


def cut_lidar(dataset: Path) -> str:
    path = first(dataset, "sweeps/LIDAR_TOP/scene-0002*")
    path.write_bytes(path.read_bytes()[:-3])
    return "no whole number"


def cut_radar(dataset: Path) -> str:
    path = first(dataset, "sweeps/RADAR_FRONT/scene-0002*")
    path.write_bytes(path.read_bytes()[:-30])
    return "points of 43 bytes"


def text_radar(dataset: Path) -> str:
    path = first(dataset, "sweeps/RADAR_FRONT/scene-0002*")
    path.write_bytes(path.read_bytes().replace(b"DATA binary", b"DATA ascii"))
    return "DATA ascii"


def other_fields(dataset: Path) -> str:
    path = first(dataset, "sweeps/RADAR_FRONT/scene-0002*")
    path.write_bytes(pcd_file({name: np.zeros(3, np.float32) for name in ("x", "y", "z", "power")}))
    return "power"


DAMAGES = (damage_image, damage_sweep, cut_image, empty_image, cut_lidar, cut_radar, text_radar, other_fields)


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_scene_that_is_damaged_leaves_the_others_alone(
    run: Any, dataset: Path, damage: Callable[[Path], str]
) -> None:
    token = damage(dataset)
    code, names, said = run()
    assert (code, names) == (3, ["scene-0001.mcap", "scene-0003.mcap"])
    assert token in said
    assert "1 of 3 scenes were not imported: scene-0002" in said


@pytest.mark.parametrize("name", ["a\0b", "a" * 5000, ""])
def test_a_file_whose_name_is_none_is_refused(run: Any, edit_table: Any, name: str) -> None:
    def rename(rows: list[dict[str, Any]]) -> None:
        next(row for row in rows if "CAM_FRONT/scene-0001" in str(row["filename"]))["filename"] = name

    edit_table("sample_data", rename)
    code, names, said = run()
    assert (code, len(names)) == (3, 2)
    assert "unpack all parts" in said


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"WIDTH", b"WIDTH 9"),
        (b"HEIGHT 1", b"HEIGHT " + b"9" * 5000),
        (b"HEIGHT 1", b"HEIGHT 99999999999"),
        (b"SIZE 4", b"SIZE 3"),
        (b"SIZE 4", b"SIZE"),
        (b"TYPE F", b"TYPE X"),
        (b"COUNT 1", b"COUNT 2"),
        (b"FIELDS x y", b"FIELDS x x"),
    ],
)
def test_headers_that_do_not_fit_are_refused(old: bytes, new: bytes) -> None:
    columns = {name: np.zeros(3, np.float32) for name in ("x", "y", "z")}
    content = pcd_file(columns)
    assert content.count(old) == 1
    with pytest.raises(DatasetError):
        read_pcd(content.replace(old, new), "a.pcd", ("x", "z"), exactly=False)


def test_a_pose_that_jumps_is_refused(run: Any, edit_table: Any) -> None:
    def jump(rows: list[dict[str, Any]]) -> None:
        rows[len(rows) // 2]["translation"][0] += 40.0

    edit_table("ego_pose", jump)
    code, names, said = run()
    assert (code, len(names)) == (3, 2)
    assert "jumps" in said


def test_a_missing_pose_is_refused(run: Any, edit_table: Any) -> None:
    edit_table("ego_pose", lambda rows: rows.pop())
    code, names, said = run()
    assert (code, len(names)) == (3, 2)
    assert "ego_pose" in said


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        ("sample_data", "timestamp", "soon"),
        ("sample_data", "timestamp", 2**70),
        ("sample_data", "filename", 5),
        ("sample_data", "ego_pose_token", []),
        ("sample_data", "width", "wide"),
        ("ego_pose", "translation", None),
        ("ego_pose", "translation", ["a", "b", "c"]),
        ("ego_pose", "translation", [1.0, 2.0]),
        ("calibrated_sensor", "rotation", "none"),
        ("calibrated_sensor", "camera_intrinsic", [5]),
        ("calibrated_sensor", "sensor_token", "none"),
        ("scene", "token", {}),
        ("scene", "name", "../scene"),
        ("scene", "name", "s" * 300),
        ("scene", "name", "a\0b"),
    ],
)
def test_values_of_another_type_are_refused(run: Any, edit_table: Any, table: str, key: str, value: object) -> None:
    edit_table(table, lambda rows: rows[0].__setitem__(key, value))
    code, names, said = run()
    assert (code, names) == (2, [])
    assert said.count("radcam-depth:") == 1


@pytest.mark.parametrize("rotation", [[0.0, 0.0, 0.0, 0.0], [float("nan"), 0.0, 0.0, 1.0]])
def test_a_place_that_is_none_is_refused(run: Any, edit_table: Any, rotation: list[float]) -> None:
    edit_table("ego_pose", lambda rows: rows[0].__setitem__("rotation", rotation))
    code, names, _ = run()
    assert (code, len(names)) == (3, 2)


def test_a_file_outside_of_the_data_set_is_refused(run: Any, edit_table: Any) -> None:
    def escape(rows: list[dict[str, Any]]) -> None:
        next(row for row in rows if "CAM_FRONT/scene-0001" in str(row["filename"]))["filename"] = "../../etc/passwd"

    edit_table("sample_data", escape)
    code, names, said = run()
    assert (code, len(names)) == (3, 2)
    assert "../../etc/passwd" in said


@pytest.mark.parametrize(
    ("options", "token"),
    [
        (("--version", "v1.0-trainval"), "v1.0-mini"),
        (("--scenes", "scene-9999"), "scene-9999"),
        (("--split", "test"), "v1.0-test"),
        (("--split", "singh-val"), "850"),
        (("--split", "valid"), "singh-train"),
        (("--images", "some"), "keyframes"),
        (("--radars", "none"), "front or all"),
        (("--cameras", "CAM_LEFT"), "CAM_LEFT"),
    ],
)
def test_options_that_do_not_fit_are_refused(run: Any, options: tuple[str, str], token: str) -> None:
    code, names, said = run(*options)
    assert (code, names) == (2, [])
    assert token in said


def test_another_data_set_is_refused(dataset: Path, tmp_path: Path, monkeypatch: Any, capfd: Any) -> None:
    assert run_main(monkeypatch, "import", "kitti", dataset, tmp_path / "out") == 2
    assert "kitti" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("text", "token"),
    [
        ('[{"token": "a", "name"', "an end within a row"),
        ('[{"token": "a", "name": "b", "description": "", "log_token": ""}', "an end within a row"),
        ('{"a": 1}', "array"),
        ("[1, 2]", "row '1'"),
        ('[{"token": "a"}]', "expected rows with"),
        ("", "array"),
        ("[" * 100_000, "lists within lists"),
    ],
)
def test_tables_that_are_none_are_refused(run: Any, dataset: Path, text: str, token: str) -> None:
    (dataset / VERSION / "scene.json").write_text(text)
    code, names, said = run()
    assert (code, names) == (2, [])
    assert token in said


def test_a_full_disk_leaves_nothing_half_written(run: Any, capfd: Any) -> None:
    # The first one ends while the last bytes are in the writer's buffer.
    for room in (2000, 100_000):
        with full_disk(room):
            code, names, said = run()
        assert (code, names) == (3, [])
        assert said.count("free some space") == 3


def test_rows_come_one_by_one_whatever_their_layout(tmp_path: Path) -> None:
    rows = [{"token": str(index), "text": '}, {"\\ é' * (index % 50)} for index in range(20_000)]
    for indent in (None, 2):
        path = tmp_path / "rows.json"
        path.write_text(json.dumps(rows, indent=indent, ensure_ascii=False), encoding="utf-8")
        assert path.stat().st_size > 2 * 2**20
        assert list(read_rows(path, ("token",))) == rows


def test_points_are_read_as_they_were_written() -> None:
    rng = np.random.default_rng(0)
    columns = {name: rng.normal(size=5).astype(np.float32) for name in NUSCENES_RADAR}
    columns["id"], columns["dyn_prop"] = np.arange(5, dtype=np.int16), np.arange(5, dtype=np.int8)
    found = read_pcd(pcd_file(columns), "a.pcd", NUSCENES_RADAR)
    assert all((found[name] == column).all() and found[name].dtype == column.dtype for name, column in columns.items())
    assert (
        len(read_pcd(pcd_file({name: column[:0] for name, column in columns.items()}), "a", NUSCENES_RADAR)["x"]) == 0
    )
    with pytest.raises(DatasetError, match="header"):
        read_pcd(b"nothing", "a.pcd", NUSCENES_RADAR)
    assert read_floats(b"", "a.bin", ("x", "y"))["x"].shape == (0,)


def test_splits_are_the_official_ones() -> None:
    known = {"scene-0001": "train", "scene-0003": "val", "scene-0018": "val", "scene-0019": "train"}
    known |= {"scene-0061": "train", "scene-0110": "val", "scene-1073": "val", "scene-1074": "train", "odd": ""}
    assert {name: split_of(name, "v1.0-trainval") for name in known} == known
    whole = [f"scene-{number:04d}" for number in range(850)]
    assert len(scenes_of("singh-val", whole, "v1.0-trainval")) == 150
    assert len(scenes_of("singh-train", whole, "v1.0-trainval")) == 700
    assert scenes_of("singh-test", whole[:3], "v1.0-test") == whole[:3]
    assert scenes_of("val", ["scene-0061", "scene-0103"], "v1.0-mini") == ["scene-0103"]
    assert "singh-test" in SPLITS
