from __future__ import annotations

import pytest
from command_line import run_main


@pytest.mark.parametrize("seeds", ["3", "5:5", "7:2", "a:b"])
def test_seeds_that_are_none_are_refused(tmp_path, monkeypatch, capsys, seeds):
    pytest.importorskip("embreex")
    assert run_main(monkeypatch, "simulate", tmp_path / "out", "--seeds", seeds) == 2
    assert "expected seeds as A:B" in capsys.readouterr().err


def test_drives_of_seeds_are_simulated_by_shards(tmp_path, monkeypatch):
    pytest.importorskip("embreex")
    config = tmp_path / "small.yaml"
    config.write_text(
        "camera: {width: 96, height: 64, min_focal_length_px: 80.0, max_focal_length_px: 80.0}\n", encoding="utf-8"
    )
    out, options = tmp_path / "drives", ("--frames", "1", "--seeds", "4:6", "--config", config)
    assert run_main(monkeypatch, "simulate", out, *options, "--shard", "0/2") == 0
    assert [path.name for path in out.glob("*.mcap")] == ["4.mcap"]
    assert run_main(monkeypatch, "simulate", out, *options) == 0
    assert sorted(path.name for path in out.glob("*.mcap")) == ["4.mcap", "5.mcap"]


def test_samples_are_prepared_by_shards(tmp_path, monkeypatch, write_truth):
    for seed in range(3):
        write_truth(tmp_path / "drives" / f"{seed}.mcap", seed)
    run, cache = tmp_path / "run", tmp_path / "cache"
    options = ("--out", run, "--bags", tmp_path / "drives", "--cache", cache, "--cache-only")
    assert run_main(monkeypatch, "train", *options, "--shard", "1/2") == 0
    assert len([path for path in cache.iterdir() if (path / "drive.json").is_file()]) == 1
    assert run_main(monkeypatch, "train", *options, "--shard", "2/2") == 0
    assert len([path for path in cache.iterdir() if (path / "drive.json").is_file()]) == 3
    assert not run.exists()


def test_a_training_is_not_sharded(tmp_path, monkeypatch, capsys):
    assert run_main(monkeypatch, "train", "--out", tmp_path / "run", "--bags", tmp_path, "--shard", "0/2") == 2
    assert "shared by torchrun" in capsys.readouterr().err
