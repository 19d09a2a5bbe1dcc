from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from surround_drive import SurroundDrive, write_surround_drive

from benchmarks import published

ROOT = Path(__file__).parents[2]


def test_the_page_has_the_published_table_with_an_empty_column_of_ours() -> None:
    assert published.markdown({}) in (ROOT / "docs/results.md").read_text(encoding="utf-8")


def test_networks_without_shipped_weights_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert published.shipped_networks() == ["baff", "lircdepth", "structured"]
    write_surround_drive(tmp_path / "drive.mcap", SurroundDrive(seconds=0.4))
    monkeypatch.setattr(sys, "argv", ["published", "--bags", str(tmp_path), "--network", "cafnet"])
    with pytest.raises(SystemExit, match="2"):
        published.main()
    assert "the weights of 'cafnet' are not installed" in capsys.readouterr().err


def test_figures_fill_the_column(
    tmp_path: Path, small_weights: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_surround_drive(tmp_path / "bags" / "drive.mcap", SurroundDrive(seconds=0.4))
    target = tmp_path / "figures.json"
    words = [
        "--bags",
        str(tmp_path / "bags"),
        "--json",
        str(target),
        "--network",
        f"baff={small_weights}",
        "--limit",
        "2",
    ]
    monkeypatch.setattr(sys, "argv", ["published", *words])
    published.main()
    figures = json.loads(target.read_text(encoding="utf-8"))["ours"]["baff"]
    assert set(figures) == {"singh2023", "cafnet", "justdepth"}
    assert all(entry["frames"] == 2 for entry in figures.values())
    mae = figures["cafnet"]["groups"]["all"]["80"]["mae"]
    assert f"| 2.053 | {mae:.3f} |" in capsys.readouterr().out
