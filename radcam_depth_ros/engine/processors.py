"""Table of processors and the number format that suits each, so that one always computes in the same."""

from __future__ import annotations

import platform
import re
from dataclasses import dataclass
from pathlib import Path

CPUINFO = Path("/proc/cpuinfo")

WORTH = 1.1
"""A row says bfloat16 where that is so many times as fast as float32: what it gains must outweigh what it rounds."""


@dataclass(frozen=True)
class Processor:
    """What a processor says of itself.

    Attributes:
        vendor: `GenuineIntel`, `AuthenticAMD`, or of Arm the implementer's number; empty where it is not told.
        family: The vendor's number of the family; 0 where it is not told.
        model: Number within the family.
        name: The model's name.
        flags: Instruction sets.
    """

    vendor: str
    family: int
    model: int
    name: str
    flags: frozenset[str]

    @classmethod
    def here(cls) -> Processor:
        """This machine's."""
        try:
            text = CPUINFO.read_text(encoding="utf-8", errors="replace")
        except OSError:
            text = ""
        return cls.parse(text)

    @classmethod
    def parse(cls, cpuinfo: str) -> Processor:
        """From the text of /proc/cpuinfo; what it lacks is empty or 0."""

        def entry(*names: str) -> str:
            found = re.search(rf"^(?:{'|'.join(names)})\s*: *(.*)$", cpuinfo, re.M)
            return found.group(1).strip() if found else ""

        def number(name: str) -> int:
            text = entry(name)
            return int(text) if text.isdecimal() else 0

        return cls(
            vendor=entry("vendor_id", "CPU implementer"),
            family=number("cpu family"),
            model=number("model"),
            name=entry("model name") or platform.processor() or platform.machine(),
            flags=frozenset(entry("flags", "Features").split()),
        )

    @property
    def has_bfloat16(self) -> bool:
        """Whether it computes in bfloat16 itself; elsewhere that is emulated, slower than float32."""
        return bool(self.flags & {"avx512_bf16", "amx_bf16", "bf16", "svebf16"})

    def __str__(self) -> str:
        known = sorted(self.flags & {"avx2", "avx512f", "avx512_bf16", "amx_bf16", "bf16", "svebf16"})
        return f"{self.name} ({self.vendor} family {self.family} model {self.model}: {' '.join(known) or 'no flags'})"


@dataclass(frozen=True)
class Row:
    """The number format of a kind of processor.

    Attributes:
        about: Which processors these are.
        vendor: As `Processor.vendor`.
        families: As `Processor.family`.
        has: Flags that they have.
        precision: `float32` or `bfloat16`.
        lacks: Flags that they lack.
    """

    about: str
    vendor: str
    families: tuple[int, ...]
    has: frozenset[str]
    precision: str
    lacks: frozenset[str] = frozenset()

    def fits(self, processor: Processor) -> bool:
        """Whether a processor is one of these."""
        is_of_family = processor.vendor == self.vendor and processor.family in self.families
        return is_of_family and self.has <= processor.flags and not self.lacks & processor.flags


_AVX512, _AMX = frozenset({"avx512_bf16"}), frozenset({"amx_bf16"})
TABLE = (
    Row("AMD Zen 4 and Zen 5", "AuthenticAMD", (25, 26), _AVX512, "bfloat16"),
    Row("Intel with AMX", "GenuineIntel", (6, 19), _AMX, "bfloat16"),
    # One vdpbf16ps a cycle against two float32 products of half as many values: nothing is gained.
    Row("Intel with AVX512_BF16 alone", "GenuineIntel", (6, 19), _AVX512, "float32", lacks=_AMX),
)
"""Processors that compute in bfloat16. `radcam-depth bench` measures what the row of another one should say."""


def row_of(processor: Processor) -> Row | None:
    """The row of the table for a processor; None where it lacks one."""
    return next((row for row in TABLE if row.fits(processor)), None)


def precision_of(processor: Processor) -> tuple[str, str]:
    """The number format for a processor, and why in a few words."""
    if not processor.has_bfloat16:
        return "float32", "the CPU does not compute in bfloat16"
    row = row_of(processor)
    if row is None:
        return "float32", "the table of processors lacks this CPU; `radcam-depth bench` measures what it should say"
    return row.precision, row.about


def advice(processor: Processor, gain: float) -> str:
    """What the table should say of a processor by a measurement, in a sentence.

    Args:
        processor: The processor.
        gain: How many times as fast as float32 bfloat16 was measured to be; NaN where that was not measured.
    """
    if not processor.has_bfloat16:
        return f"precision auto takes float32: {processor} does not compute in bfloat16"
    row = row_of(processor)
    measured = "bfloat16" if gain >= WORTH else "float32"
    figure = f"bfloat16 was {gain:.2f} times as fast as float32 here"
    if row is None:
        return f"precision auto takes float32, since its table lacks {processor}: {figure}, so it should say {measured}"
    agrees = "as the table says" if row.precision == measured else f"but the table says {row.precision}"
    return f"precision auto takes {row.precision} ({row.about}): {figure}, {agrees}"
