from __future__ import annotations

import runpy
from pathlib import Path

import pytest

GENERATE = str(Path(__file__).parents[1] / "scripts" / "generate_pages.py")


def test_generated_pages_are_as_the_tables_say(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", [GENERATE, "--check"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(GENERATE, run_name="__main__")
    assert ended.value.code == 0


def test_each_page_that_is_generated_says_by_what() -> None:
    for path, text in runpy.run_path(GENERATE)["pages"]().items():
        assert "scripts/generate_pages.py" in text, path
