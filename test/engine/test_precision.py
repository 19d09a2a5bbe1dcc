from __future__ import annotations

import pytest
import torch

from radcam_depth_ros.engine import EngineError, precision
from radcam_depth_ros.engine.precision import NumberFormat, choose, processor_has_bfloat16, speedup_of_bfloat16

CPU = torch.device("cpu")


@pytest.mark.parametrize(
    ("has_bfloat16", "gain", "expected", "reason"),
    [
        (False, 9.0, "float32", "the CPU does not compute in bfloat16"),
        (True, 0.5, "float32", "measured: bfloat16 0.5 times as fast"),
        (True, 1.05, "float32", "measured: bfloat16 1.1 times as fast"),
        (True, 2.5, "bfloat16", "measured: 2.5 times as fast as float32"),
    ],
)
def test_auto_takes_bfloat16_where_it_is_worth_it(
    monkeypatch: pytest.MonkeyPatch, has_bfloat16: bool, gain: float, expected: str, reason: str
) -> None:
    monkeypatch.setattr(precision, "processor_has_bfloat16", lambda: has_bfloat16)
    monkeypatch.setattr(precision, "speedup_of_bfloat16", lambda: gain)
    chosen = choose("auto", CPU)
    assert (chosen.name, chosen.reason) == (expected, reason)


@pytest.mark.parametrize(("supported", "expected"), [(True, "bfloat16"), (False, "float32")])
def test_a_gpu_is_asked(monkeypatch: pytest.MonkeyPatch, supported: bool, expected: str) -> None:
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation: supported)
    assert choose("auto", torch.device("cuda")).name == expected


@pytest.mark.parametrize("asked", ["float32", "bfloat16"])
def test_what_is_asked_for_is_taken(asked: str) -> None:
    chosen = choose(asked, CPU)
    assert (chosen.name, chosen.reason) == (asked, "as asked")


def test_others_are_refused() -> None:
    with pytest.raises(EngineError, match="precision must be one of"):
        choose("float16", CPU)
    with pytest.raises(EngineError, match=r"runs in float32 or bfloat16, got torch\.float64"):
        NumberFormat(torch.float64, "")


def test_the_measurement_is_made_once_and_leaves_the_threads_as_they_are() -> None:
    threads = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        gain = speedup_of_bfloat16()
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(threads)
    assert gain > 0
    assert speedup_of_bfloat16() == gain
    assert isinstance(processor_has_bfloat16(), bool)
