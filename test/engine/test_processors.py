from __future__ import annotations

import math
from pathlib import Path

import pytest

from radcam_depth_ros.engine import processors
from radcam_depth_ros.engine.processors import TABLE, Processor, advice, precision_of, row_of

AMD = """processor\t: 0
vendor_id\t: AuthenticAMD
cpu family\t: 25
model\t\t: 17
model name\t: AMD EPYC 9R14
flags\t\t: fpu avx2 avx512f avx512_bf16
"""
ARM = """processor\t: 0
Features\t: fp asimd bf16
CPU implementer\t: 0x41
"""


def processor(vendor: str, family: int, *flags: str) -> Processor:
    return Processor(vendor, family, 1, "a CPU", frozenset(flags))


def test_cpuinfo_is_read() -> None:
    read = Processor.parse(AMD)
    assert (read.vendor, read.family, read.model, read.name) == ("AuthenticAMD", 25, 17, "AMD EPYC 9R14")
    assert read.flags == {"fpu", "avx2", "avx512f", "avx512_bf16"}
    arm = Processor.parse(ARM)
    assert (arm.vendor, arm.family) == ("0x41", 0)
    assert arm.has_bfloat16


def test_a_machine_without_cpuinfo_computes_in_float32(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(processors, "CPUINFO", tmp_path / "missing")
    assert precision_of(Processor.here())[0] == "float32"


@pytest.mark.parametrize(
    ("one", "expected"),
    [
        (processor("AuthenticAMD", 25, "avx512_bf16"), "bfloat16"),
        (processor("AuthenticAMD", 26, "avx512_bf16"), "bfloat16"),
        (processor("AuthenticAMD", 23, "avx2"), "float32"),
        (processor("GenuineIntel", 6, "avx512_bf16", "amx_bf16"), "bfloat16"),
        (processor("GenuineIntel", 6, "avx512_bf16"), "float32"),
        (processor("GenuineIntel", 6, "avx512f"), "float32"),
        (Processor.parse(ARM), "float32"),
        (processor("AuthenticAMD", 99, "avx512_bf16"), "float32"),
    ],
)
def test_each_family_has_its_format(one: Processor, expected: str) -> None:
    assert precision_of(one)[0] == expected


def test_no_processor_is_in_two_rows() -> None:
    for row in TABLE:
        for family in row.families:
            one = processor(row.vendor, family, *row.has)
            assert [other.about for other in TABLE if other.fits(one)] == [row.about]


def test_a_processor_that_the_table_lacks_is_told_what_to_do() -> None:
    unknown = processor("AuthenticAMD", 99, "avx512_bf16")
    assert row_of(unknown) is None
    assert "radcam-depth bench" in precision_of(unknown)[1]
    assert "table lacks" in advice(unknown, 1.9)
    assert advice(unknown, 1.9).endswith("so it should say bfloat16")
    assert advice(unknown, 1.0).endswith("so it should say float32")


@pytest.mark.parametrize(("gain", "ending"), [(2.0, "as the table says"), (1.0, "but the table says bfloat16")])
def test_a_measurement_is_held_against_the_table(gain: float, ending: str) -> None:
    assert advice(Processor.parse(AMD), gain).endswith(ending)


def test_a_processor_without_bfloat16_needs_no_measurement() -> None:
    assert "does not compute in bfloat16" in advice(processor("AuthenticAMD", 23, "avx2"), math.nan)
