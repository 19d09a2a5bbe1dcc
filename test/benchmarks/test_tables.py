from __future__ import annotations

import sys
from pathlib import Path

import pytest

from benchmarks import tables


def test_a_scene_is_imported_out_of_generated_tables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["tables", "--folder", str(tmp_path), "--scenes", "2"])
    tables.main()
    printed = capfd.readouterr().out
    assert "2 scenes, tables of" in printed
    assert "what the tables say of 2 scenes" in printed
    assert (tmp_path / "bags" / "scene-0000.mcap").is_file()
