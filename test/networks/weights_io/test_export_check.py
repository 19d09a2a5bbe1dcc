"""Exported files that could do more than compute are not read, however they are written."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from radcam_depth_ros import networks
from radcam_depth_ros.networks.weights_io import archive, torchscript
from radcam_depth_ros.networks.weights_io.archive import Archive, ArchiveError, Card
from radcam_depth_ros.networks.weights_io.export_check import ExportError, check_export

CODE = "code/__torch__/foreign.py"


def made(module: torch.nn.Module) -> bytes:
    """A module as torch saves it, with a card."""
    content = io.BytesIO()
    with torchscript._quiet_jit():
        torch.jit.save(torch.jit.script(module), content, _extra_files={torchscript.CARD_ENTRY: "network: baff"})
    return content.getvalue()


class Writes(torch.nn.Module):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        torch.save(x, "written")
        return x


class Runs(torch.nn.Module):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x

    @torch.jit.export
    def __getstate__(self) -> tuple[torch.Tensor, bool]:
        return torch.zeros(1), self.training

    @torch.jit.export
    def __setstate__(self, state: tuple[torch.Tensor, bool]) -> None:
        torch.save(state[0], "written")
        self.training = state[1]


class Computes(torch.nn.Module):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return torch.relu(x) + 1


@pytest.fixture(scope="module")
def export(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """An export of this package, the smallest there is."""
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("export") / "baff.pt"
    network = networks.create("baff", {"channels": [8, 8, 8, 8], "blocks": [1, 1, 1, 1]}).eval()
    torchscript.export(Archive(network, Card.of(network, "baff", "nothing")), path)
    return path.read_bytes()


def entries(content: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        return {entry.filename: file.read(entry) for entry in file.infolist()}


def packed(files: dict[str, bytes | str], comment: bytes = b"") -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as file:
        for name, data in files.items():
            file.writestr(name, data)
        file.comment = comment
    return content.getvalue()


def refused(content: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Why a file is refused, which writes nothing."""
    path, aside = tmp_path / "foreign.pt", tmp_path / "aside"
    path.write_bytes(content)
    aside.mkdir()
    monkeypatch.chdir(aside)
    with pytest.raises(ArchiveError, match=r"foreign\.pt is not read: ") as error:
        archive.load(path)
    assert list(aside.iterdir()) == []
    return str(error.value)


@pytest.mark.parametrize(
    ("module", "reason"),
    [(Writes, "calls 'torch.save'"), (Runs, "the function '__getstate__' besides forward")],
)
def test_code_that_could_do_more_than_compute(
    module: type[torch.nn.Module], reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert reason in refused(made(module()), tmp_path, monkeypatch)


def test_code_under_a_name_of_other_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """torch finds entries whatever the case of their letters."""
    files = {re.sub(r"\.py$", ".PY", name): data for name, data in entries(made(Runs())).items()}
    assert "is none that an export has" in refused(packed(files), tmp_path, monkeypatch)


def test_a_local_header_with_another_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """torch goes by the directory at the archive's end, Python compares both."""
    content = bytearray(made(Runs()))
    name = next(name for name in entries(bytes(content)) if name.endswith(".py")).encode()
    place = content.index(name)
    content[place + 1] ^= 1
    assert "Python cannot read all of it" in refused(bytes(content), tmp_path, monkeypatch)


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("class A(Module):\n  def forward(self, x):\n    torch . \\\n    save(x, 'a')\n", "calls 'torch.save'"),
        ("def forward(self, x):\n  y = '#'; ops.aten.from_file('a', True)\n", "calls 'ops.aten.from_file'"),
        ("def forward(self, x):\n  ops.image.write_file('a', x)\n", "calls 'ops.image.write_file'"),
        ("def forward(self, x):\n  (self.f)(x)\n", "calls 'self.f'"),
        ("def forward(self, x):\n  __torch__.torch.classes.a.B(x)\n", "calls '__torch__.torch.classes.a.B'"),
        ("def forward(self, x):\n  open('a', 'w')\n", "calls 'open'"),
        ("def forward(self, x):\n  return (lambda: x)()\n", "calls"),
        ("import os\n", "'Import'"),
        ("def __setstate__(self, x):\n  return x\n", "'__setstate__'"),
        ("def forward(self, x:\n", "cannot be read"),
        ("x = " + "(" * 5000 + ")" * 5000, "cannot be read"),
    ],
)
def test_code_however_it_is_written(
    code: str, reason: str, export: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files: dict[str, bytes | str] = {**entries(export)}
    folder = next(iter(files)).split("/")[0]
    assert reason in refused(packed({**files, f"{folder}/{CODE}": code}), tmp_path, monkeypatch)


def _with(change: Callable[[dict[str, bytes]], dict[str, Any]]) -> Callable[[bytes], bytes]:
    return lambda content: packed(change(entries(content)))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda content: b"", "no archive"),
        (lambda content: b"not a network", "no archive"),
        (lambda content: b"PK\x03\x04 broken", "Python cannot read all of it"),
        (lambda content: b"x" + content, "no archive"),
        (lambda content: content[:-30], "cannot read"),
        (lambda content: packed(entries(content), b"a comment"), "a comment"),
        (_with(lambda files: {**files, "other/version": b"3"}), "the same name"),
        (_with(lambda files: {**files, "other/constants/99999": b"3"}), "in one folder"),
        (_with(lambda files: {**files, "baff/code/__torch__/../a.py": b""}), "is none that an export has"),
        (_with(lambda files: {**files, "baff/extra/more": b""}), "is none that an export has"),
        (
            _with(
                lambda files: {name: b"x" * 70_000 if name.endswith("yaml") else data for name, data in files.items()}
            ),
            "its card has 70000 bytes",
        ),
    ],
)
def test_archives_that_no_export_is(
    change: Callable[[bytes], bytes], reason: str, export: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert reason in refused(change(export), tmp_path, monkeypatch)


@pytest.mark.parametrize("number", [1_000, 2**31 - 1, 2**32 - 1])
def test_a_pickle_does_not_make_torch_take_gigabytes(number: int, export: bytes) -> None:
    files = entries(export)
    name = next(name for name in files if name.endswith("/constants.pkl"))
    files[name] = b"\x80\x02)r" + number.to_bytes(4, "little") + b"."
    with pytest.raises(ExportError, match=f"remembers its value 2 as number {number}"):
        check_export(packed(files))


@pytest.mark.parametrize("what", ["cos\nsystem\n", "c__torch__.torch.classes.a\nB\n", "cbuiltins\neval\n"])
def test_pickles_that_make_anything_but_tensors(what: str, export: bytes) -> None:
    files = entries(export)
    name = next(name for name in files if name.endswith("/data.pkl"))
    with pytest.raises(ExportError, match="one of its pickles makes"):
        check_export(packed({**files, name: b"\x80\x02" + what.encode() + b"."}))


@pytest.mark.parametrize("kept", [slice(0), slice(-1), slice(4)])
def test_a_tensor_that_is_shorter_than_its_pickle_says(kept: slice, export: bytes) -> None:
    def cut(files: dict[str, bytes]) -> dict[str, Any]:
        name = max((name for name in files if "/constants/" in name), key=lambda name: len(files[name]))
        return {**files, name: files[name][kept]}

    with pytest.raises(ExportError, match=r"its tensor constants/\d+ has \d+ bytes in place of \d+"):
        check_export(_with(cut)(export))


@pytest.mark.parametrize("counts", [(2**29, 3), (3, 2**29), (2, 3)])
def test_a_tensor_that_is_named_twice_with_other_lengths(counts: tuple[int, int], export: bytes) -> None:
    def storage(count: int) -> bytes:
        length = b"J" + count.to_bytes(4, "little")
        return b"(X\x07\x00\x00\x00storagectorch\nFloatStorage\nX\x01\x00\x00\x000X\x03\x00\x00\x00cpu" + length + b"tQ"

    def named_twice(files: dict[str, bytes]) -> dict[str, Any]:
        folder = next(iter(files)).partition("/")[0]
        twice = b"\x80\x02(" + storage(counts[0]) + storage(counts[1]) + b"t."
        return {**files, f"{folder}/constants.pkl": twice, f"{folder}/constants/0": bytes(12)}

    with pytest.raises(ExportError, match="its tensor constants/0 has 12 bytes in place of"):
        check_export(_with(named_twice)(export))


def test_a_small_file_that_becomes_a_large_one() -> None:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("bomb/constants/0", bytes(5_000_000))
    with pytest.raises(ExportError, match="becomes 5000000 bytes"):
        check_export(content.getvalue())


def test_the_bytes_that_were_checked_are_the_bytes_that_are_loaded(
    export: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "baff.pt"
    path.write_bytes(export)

    def check_and_replace(content: bytes) -> None:
        check_export(content)
        path.write_bytes(made(Writes()))

    monkeypatch.setattr(torchscript, "check_export", check_and_replace)
    assert archive.load(path).card.network == "baff"


def test_a_module_that_only_computes_needs_a_card_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "computes.pt"
    path.write_bytes(made(Computes()))
    with pytest.raises(ArchiveError, match="the card does not fit"):
        archive.load(path)


@pytest.mark.parametrize("seed", range(4))
def test_a_damaged_export_is_refused_in_a_sentence_or_is_as_it_was(seed: int, export: bytes) -> None:
    rng = np.random.default_rng(seed)
    tails = [len(export) - 60_000, 0]
    for index in range(40):
        content = bytearray(export)
        # Half of the changes are in the archive's directory, at its end.
        place = int(rng.integers(max(tails[index % 2], 0), len(export)))
        content[place] ^= 1 << int(rng.integers(8))
        with suppress(ExportError):
            check_export(bytes(content))
            assert entries(bytes(content)) == entries(export)
