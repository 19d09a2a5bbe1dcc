"""Two shards merged give what one process gives, to the last digit."""

from __future__ import annotations

import json

import pytest
from command_line import run_main

from radcam_depth_ros.bags import BagReader


@pytest.fixture
def drives(tmp_path, write_truth):
    folder = tmp_path / "drives"
    for seed, weather in enumerate(("rain", "dry", "rain", "fog", "")):
        scenario = {"weather": weather, "time_of_day": "night" if seed % 2 else "day"} if weather else None
        write_truth(folder / f"{seed}.mcap", seed, 1 + seed % 3, scenario)
    write_truth(folder / "again" / "2.mcap", 2, 3)
    return folder


def measured(capsys):
    plain = json.loads(capsys.readouterr().out)
    plain.pop("latency_ms", None)
    return plain


@pytest.mark.usefixtures("loaded")
def test_shards_merged_are_one_process(tmp_path, drives, monkeypatch, capsys):
    out, page = tmp_path / "results", tmp_path / "page.html"
    assert run_main(monkeypatch, "evaluate", drives, "--json", "-") == 0
    whole = measured(capsys)
    assert len(whole["bags"]) == 6
    for shard in ("2/3", "3/3"):
        assert run_main(monkeypatch, "evaluate", drives, "--out", out, "--shard", shard) == 0
    assert run_main(monkeypatch, "merge", out) == 2
    assert "2 of 6 drives" in capsys.readouterr().err
    assert run_main(monkeypatch, "evaluate", drives, "--out", out, "--shard", "1/3") == 0
    capsys.readouterr()
    assert run_main(monkeypatch, "merge", out, "--json", "-", "--report", page) == 0
    assert measured(capsys) == whole
    text = page.read_text(encoding="utf-8")
    for part in ("The worst drives", "where the network doubts most", "Drives by weather", "Drives by folder"):
        assert part in text
    # All in one run, and all at once from what is there.
    assert run_main(monkeypatch, "evaluate", drives, "--out", out, "--json", "-") == 0
    assert measured(capsys) == whole
    assert run_main(monkeypatch, "evaluate", drives, "--on", "local", "--json", "-") == 0
    assert measured(capsys) == whole


@pytest.mark.usefixtures("loaded")
def test_a_bad_drive_is_left_out_and_told(tmp_path, drives, monkeypatch, capsys):
    (drives / "9.mcap").write_bytes(b"no bag at all")
    out = tmp_path / "results"
    assert run_main(monkeypatch, "evaluate", drives, "--out", out, "--json", "-", "--no-baselines") == 3
    told = capsys.readouterr()
    assert len(json.loads(told.out)["bags"]) == 6
    assert "9.mcap" in told.err
    assert run_main(monkeypatch, "merge", out, "--json", "-") == 3


@pytest.mark.usefixtures("loaded")
@pytest.mark.parametrize(
    ("options", "part"),
    [
        (("--shard", "3/2", "--out", "out"), "expected a shard i/n"),
        (("--shard", "0/2"), "give --out DIR"),
        (("--on", "slurm"), "expected local, ray or ray://HOST:PORT"),
        (("--protocol", "mine", "--out", "out"), "expected a protocol"),
        (("--out", "out", "--csv", "frames.csv"), "leave out --csv"),
    ],
)
def test_bad_requests_are_one_sentence(tmp_path, drives, monkeypatch, capsys, options, part):
    monkeypatch.chdir(tmp_path)
    assert run_main(monkeypatch, "evaluate", drives, *options) == 2
    told = capsys.readouterr().err
    assert part in told
    assert "Traceback" not in told
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("loaded")
def test_other_settings_and_other_folders_are_refused(tmp_path, drives, monkeypatch, capsys):
    out = tmp_path / "results"
    assert (
        run_main(monkeypatch, "evaluate", drives, "--out", out, "--limit", "1", "--no-baselines", "--shard", "0/6") == 0
    )
    asked = ("evaluate", drives, "--out", out, "--no-baselines")
    assert run_main(monkeypatch, *asked, "--limit", "1", "--shard", "0/6") == 0
    assert run_main(monkeypatch, *asked, "--limit", "2") == 2
    assert "other settings: limit (1, now 2)" in capsys.readouterr().err
    assert run_main(monkeypatch, "replay", drives, out) == 2
    assert "results of `radcam-depth evaluate`" in capsys.readouterr().err
    assert run_main(monkeypatch, "merge", tmp_path) == 2
    assert "there is no plan.json" in capsys.readouterr().err
    assert run_main(monkeypatch, "merge", out, "--partial", "--json", "-") == 0


@pytest.mark.usefixtures("loaded")
def test_many_bags_are_replayed_to_a_folder(tmp_path, drives, monkeypatch, capsys):
    (drives / "9.mcap").write_bytes(b"no bag at all")
    out = tmp_path / "depth"
    assert run_main(monkeypatch, "replay", drives, out, "--shard", "0/2") == 0
    assert run_main(monkeypatch, "replay", drives, out) == 3
    bags = sorted(out.glob("*.mcap"))
    assert [bag.name for bag in bags][:3] == ["0.mcap", "1.mcap", bags[2].name]
    assert len(bags) == 6
    with BagReader(bags[0]) as reader:
        assert "/depth/image_rect" in {topic.name for topic in reader.topics}
    before = bags[0].stat().st_ino
    bags[1].unlink()  # taken away by somebody: made again
    assert run_main(monkeypatch, "replay", drives, out) == 3
    assert bags[1].is_file()
    assert bags[0].stat().st_ino == before
