from __future__ import annotations

import pytest
import torch

from radcam_depth_ros.engine import Engine, EngineError, Processor, precision
from radcam_depth_ros.engine.precision import VARIABLE, NumberFormat, choose

CPU = torch.device("cpu")
ZEN_4 = Processor("AuthenticAMD", 25, 17, "AMD EPYC", frozenset({"avx2", "avx512f", "avx512_bf16"}))
XEON = Processor("GenuineIntel", 6, 143, "Intel Xeon", frozenset({"avx2", "avx512f", "avx512_bf16"}))


@pytest.fixture(autouse=True)
def _empty_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)


@pytest.mark.parametrize(("processor", "expected"), [(ZEN_4, "bfloat16"), (XEON, "float32")])
def test_auto_follows_the_table_of_processors(
    monkeypatch: pytest.MonkeyPatch, processor: Processor, expected: str
) -> None:
    monkeypatch.setattr(precision.Processor, "here", lambda: processor)
    assert choose("auto", CPU).name == expected


@pytest.mark.parametrize("told", ["float32", "bfloat16"])
@pytest.mark.parametrize("processor", [ZEN_4, XEON])
def test_the_environment_overrides_the_table_and_the_gpu(
    monkeypatch: pytest.MonkeyPatch, processor: Processor, told: str
) -> None:
    monkeypatch.setattr(precision.Processor, "here", lambda: processor)
    monkeypatch.setenv(VARIABLE, told)
    for device in (CPU, torch.device("cuda")):
        chosen = choose("auto", device)
        assert (chosen.name, chosen.reason) == (told, f"as {VARIABLE} says")


@pytest.mark.parametrize("told", ["", "auto"])
def test_an_environment_that_says_nothing_leaves_the_table(monkeypatch: pytest.MonkeyPatch, told: str) -> None:
    monkeypatch.setattr(precision.Processor, "here", lambda: ZEN_4)
    monkeypatch.setenv(VARIABLE, told)
    assert choose("auto", CPU).name == "bfloat16"


@pytest.mark.parametrize("asked", ["float32", "bfloat16"])
def test_what_is_asked_for_is_taken_whatever_the_environment_says(monkeypatch: pytest.MonkeyPatch, asked: str) -> None:
    monkeypatch.setenv(VARIABLE, "bfloat16" if asked == "float32" else "float32")
    chosen = choose(asked, CPU)
    assert (chosen.name, chosen.reason) == (asked, "as asked")


@pytest.mark.parametrize("asked", ["auto", "float32"])
def test_a_wrong_environment_is_refused_by_name(monkeypatch: pytest.MonkeyPatch, asked: str) -> None:
    monkeypatch.setenv(VARIABLE, "half")
    with pytest.raises(EngineError, match=f"{VARIABLE} must be one of auto, float32, bfloat16, got 'half'"):
        choose(asked, CPU)
    with pytest.raises(EngineError, match=VARIABLE):
        Engine(torch.nn.Identity(), precision=asked, mode="eager")


@pytest.mark.parametrize(("supported", "expected"), [(True, "bfloat16"), (False, "float32")])
def test_a_gpu_is_asked(monkeypatch: pytest.MonkeyPatch, supported: bool, expected: str) -> None:
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation: supported)
    assert choose("auto", torch.device("cuda")).name == expected


def test_others_are_refused() -> None:
    with pytest.raises(EngineError, match="precision must be one of"):
        choose("float16", CPU)
    with pytest.raises(EngineError, match=r"runs in float32 or bfloat16, got torch\.float64"):
        NumberFormat(torch.float64, "")
