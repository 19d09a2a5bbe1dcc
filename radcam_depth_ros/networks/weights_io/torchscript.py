"""Exports networks to TorchScript files with the card inside, and reads them.

This is the only module that touches torch.jit, which torch deprecates: its successor, torch.export, is tried in tests.
"""

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import cast

import torch
from torch import nn

from radcam_depth_ros.files import whole
from radcam_depth_ros.networks.weights_io.card import Archive, ArchiveError, card_text, read_card
from radcam_depth_ros.networks.weights_io.export_check import ExportError, check_export, check_graph
from radcam_depth_ros.networks.weights_io.folding import folded

CARD_ENTRY = "card.yaml"


def export(archive: Archive, path: Path | str) -> None:
    """Writes one self-contained TorchScript file, frozen, with the card inside; a C++ node can load it as well."""
    target = Path(path)
    module = freeze(archive.network)
    content = io.BytesIO()
    with _quiet_jit():
        torch.jit.save(module, content, _extra_files={CARD_ENTRY: card_text(archive.card)})
    with whole(target) as temporary:
        # No view of the buffer: where writing fails, Python 3.12.1 collects both in an order that ends the process.
        temporary.write_bytes(content.getvalue())


def freeze(network: nn.Module, dtype: torch.dtype = torch.float32) -> torch.jit.ScriptModule:
    """Scripts a copy of a network with its batch norms and constants folded; the network itself stays as it is.

    Args:
        network: Any scriptable module; one that is frozen already, from an export, is returned as it is.
        dtype: Of its weights and maps, rounded after folding.
    """
    if isinstance(network, torch.jit.ScriptModule):
        return network
    # torch keeps all that it scripts until the process ends, and freezing writes the weights into it. What is read from
    # a file goes when nobody holds it, so both steps go by one. Reading again after freezing is for errors while the
    # network runs: torch looks for the code as it was before, and crashes where that is gone.
    with _quiet_jit():
        scripted = _reread(torch.jit.script(folded(network, dtype)))
        return _reread(torch.jit.freeze(scripted.eval()))


def _reread(module: torch.jit.ScriptModule) -> torch.jit.ScriptModule:
    content = io.BytesIO()
    torch.jit.save(module, content)
    content.seek(0)
    reread = torch.jit.load(content)  # type: ignore[no-untyped-call]  # torch leaves it without types
    return cast(torch.jit.ScriptModule, reread)


def load(path: Path, content: bytes) -> Archive:
    """Makes a network of an exported file's bytes; ArchiveError, which names the path, where it is none or not safe."""
    extra = {CARD_ENTRY: ""}
    try:
        check_export(content)
        with _quiet_jit():
            module: torch.jit.ScriptModule = torch.jit.load(  # type: ignore[no-untyped-call]  # torch has no types
                io.BytesIO(content), map_location="cpu", _extra_files=extra
            )
        check_graph(module)
    except ExportError as fault:
        raise ArchiveError(f"{path} is not read: {fault}; make it anew with `radcam-depth export`") from None
    except (RuntimeError, ValueError, MemoryError) as error:  # of memory: a damaged number asks torch for too much
        reason = str(error).splitlines()[0]
        raise ArchiveError(
            f"{path} is neither .safetensors nor a TorchScript file that can be read ({reason}); make one with "
            "`radcam-depth export`"
        ) from None
    text: str | bytes = extra[CARD_ENTRY]
    if not text:
        raise ArchiveError(f"{path} is a TorchScript file without a card; make it with `radcam-depth export`")
    card = read_card(text.decode("utf-8") if isinstance(text, bytes) else text, str(path))
    return Archive(module, card)


@contextmanager
def _quiet_jit() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*torch.jit.*", category=DeprecationWarning)
        yield
