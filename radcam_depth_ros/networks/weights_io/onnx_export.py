"""Exports networks to ONNX files with the card inside, and compares each with the network before it gets its name."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor, nn

from radcam_depth_ros.files import whole
from radcam_depth_ros.networks.interface import Depths, Network
from radcam_depth_ros.networks.weights_io import onnx_file
from radcam_depth_ros.networks.weights_io.card import Archive, ArchiveError, card_text
from radcam_depth_ros.networks.weights_io.export_check import LARGEST_BYTES
from radcam_depth_ros.networks.weights_io.folding import folded

if TYPE_CHECKING:
    import onnx

OPSET = 18
"""The least that torch's exporter writes."""
NEWEST_OPSET = 23
CHECKED_RETURNS = (0, 60, 1000)
TOLERANCE = 1e-3
"""Metres, and for probabilities a share, by which an export may differ from its network."""
DECIDED_SHARE = 1e-4
"""Share of pixels that may differ more: where two returns or classes suit equally well, rounding decides."""

TRIES = 3
"""Made-up frames with each number of returns; most must agree, since one pixel that rounding decides spreads to others.

Folding batch norms alone can do that: with 1,000 returns one pixel of `baff` takes another, and 1.7 % of depths change.
"""


class Standalone(nn.Module):
    """A network that takes a frame as it comes, as an exported file does.

    Args:
        network: What is called.
    """

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor, radar: Tensor, ground: Tensor) -> tuple[Tensor, ...]:
        """Calls the network.

        Args:
            image: (H, W, 3) uint8 RGB.
            radar: (N, 6) float32, columns of `RADAR_COLUMNS`; rows whose depth is not above 0 are padding.
            ground: (4,) float32, as the networks' interface has it.

        Returns:
            Those of the fields of `Depths` that the network gives.
        """
        pixels = image.permute(2, 0, 1).unsqueeze(0).float() / 255.0
        valid = radar[:, 2] > 0
        filled = torch.where(valid.unsqueeze(1), radar, torch.ones_like(radar))
        depths = self.network(pixels, filled.unsqueeze(0), valid.unsqueeze(0), ground.unsqueeze(0))
        return tuple(maps for maps in depths if maps is not None)


def require_packages() -> None:
    """Refuses where what an export needs is not installed, by an ArchiveError that names the extra."""
    onnx_file.require("an export to ONNX", "onnx", "onnxscript", "onnxruntime")


def export(archive: Archive, path: Path | str, height: int, width: int, opset: int = OPSET) -> None:
    """Writes one ONNX file for images of one size and any number of returns, with the weights and the card inside.

    onnxruntime runs it on made-up frames with 0, 60 and 1,000 returns before the file gets its name.

    Args:
        archive: What to export; no export itself.
        path: The file.
        height: Rows of the image as the network sees it, a multiple of 32.
        width: Columns, likewise.
        opset: Version of ONNX's operators.

    Raises:
        ArchiveError: where that cannot be, or the file gives another depth than the network.
    """
    require_packages()
    if not isinstance(archive.network, Network):
        raise ArchiveError(
            "expected weights in a .safetensors file to export as ONNX, got an exported file; give the weights"
        )
    if not OPSET <= opset <= NEWEST_OPSET:
        raise ArchiveError(f"expected an opset from {OPSET} to {NEWEST_OPSET}, got {opset}; give --opset {OPSET}")
    target = Path(path)
    model = _translated(Standalone(folded(archive.network)), height, width, opset)
    entry = model.metadata_props.add()
    entry.key, entry.value = onnx_file.CARD_KEY, card_text(archive.card)
    content = onnx_file.seal(model.SerializeToString())
    if len(content) > LARGEST_BYTES:
        raise ArchiveError(f"expected at most {LARGEST_BYTES} bytes in an ONNX file, got {len(content)}")
    # What is compared is what a node would load of these bytes.
    written = onnx_file.load(target, content).network
    for returns in CHECKED_RETURNS:
        _compare(Standalone(archive.network), written, [made_up_frame(height, width, returns, n) for n in range(TRIES)])
    with whole(target) as temporary:
        temporary.write_bytes(content)


def _translated(network: Standalone, height: int, width: int, opset: int) -> onnx.ModelProto:
    example = made_up_frame(height, width, 9)
    with torch.inference_mode():
        given = len(network(*example))
        with_classes = any(maps.dtype == torch.uint8 for maps in network(*example))
    outputs = [*Depths._fields[:3], *(["classes"] if with_classes else [])]
    outputs += ["sky"] if given > len(outputs) else []
    with _quiet():
        program = torch.onnx.export(
            network.to(memory_format=torch.contiguous_format).eval(),  # type: ignore[call-overload]  # torch lacks it
            example,
            dynamo=True,
            input_names=list(onnx_file.INPUTS),
            output_names=outputs,
            opset_version=opset,
            dynamic_shapes={"image": {}, "radar": {0: torch.export.Dim("returns", min=0)}, "ground": {}},
            verbose=False,
        )
    if program is None:
        raise ArchiveError("torch wrote no ONNX model; install the versions of constraints.txt")
    model: onnx.ModelProto = program.model_proto
    used = {entry.domain: entry.version for entry in model.opset_import}
    if used.get("") != opset:
        raise ArchiveError(f"expected a model of opset {opset} from torch, got {used.get('')}; give --opset {OPSET}")
    _strip(model)
    return model


def _strip(model: onnx.ModelProto) -> None:
    """Removes what torch notes for those who look for its errors: sources and paths of this computer."""
    kept = next(entry.version for entry in model.opset_import if not entry.domain)
    del model.opset_import[:]
    model.opset_import.add().version = kept
    del model.metadata_props[:]
    graph = model.graph
    del graph.value_info[:]
    for part in (graph, *graph.node, *graph.initializer, *graph.input, *graph.output):
        part.doc_string = ""
        del part.metadata_props[:]
    model.producer_name, graph.name = "radcam_depth_ros", "radcam_depth"


def made_up_frame(height: int, width: int, returns: int, number: int = 0) -> tuple[Tensor, Tensor, Tensor]:
    """A sky over a grey road with noise, and returns all over the image; always the same for the same numbers."""
    generator = torch.Generator().manual_seed(returns + 10_000 * number)
    horizon = 0.45 * height
    rows = torch.arange(height, dtype=torch.float32).reshape(-1, 1, 1)
    noise = 20.0 * torch.randn(height, width, 3, generator=generator)
    image = (torch.where(rows < horizon, torch.tensor([150.0, 180.0, 220.0]), torch.tensor(90.0)) + noise).clamp(0, 255)
    extent = torch.tensor([width - 1.0, height - 1.0, 75.0, 30.0, 20.0, 0.1])
    radar = torch.rand(returns, 6, generator=generator) * extent + torch.tensor([0.0, 0.0, 3.0, -10.0, -10.0, 0.0])
    slope = 1.0 / (630.0 * 1.5)
    return image.byte().contiguous(), radar, torch.tensor([0.0, slope, -slope * horizon, 1.0])


def _compare(network: Standalone, written: nn.Module, frames: Sequence[tuple[Tensor, Tensor, Tensor]]) -> None:
    """Refuses an export that gives something else than its network on half of these frames or more."""
    if not isinstance(written, onnx_file.OnnxNetwork):
        raise TypeError(f"expected an OnnxNetwork, got {type(written).__name__}")
    session = onnx_file.open_session(written, ["CPUExecutionProvider"], torch.get_num_threads())
    differing: list[tuple[str, float]] = []
    for frame in frames:
        with torch.inference_mode():
            expected = network.eval()(*frame)
        named = dict(zip(onnx_file.INPUTS, (value.numpy() for value in frame), strict=True))
        found = session.run(None, named)
        shares = [differing_share(mine.numpy(), theirs) for mine, theirs in zip(expected, found, strict=True)]
        pairs = zip(written.outputs, shares, strict=True)
        differing += [pair for pair in pairs if pair[1] > DECIDED_SHARE][:1]
    if 2 * len(differing) < len(frames):
        return
    name, share = differing[0]
    raise ArchiveError(
        f"expected {name} of the ONNX file within {TOLERANCE:g} of the network's at {len(frames[0][1])} returns, got "
        f"{100 * share:.2g} % of the pixels that differ more; nothing was written, use the TorchScript export (.pt)"
    )


def differing_share(expected: Any, found: Any) -> float:
    """Share of pixels that differ by more than `TOLERANCE`, or have a value in one map alone."""
    mine, theirs = np.asarray(expected, np.float64), np.asarray(found, np.float64)
    if mine.shape != theirs.shape:
        return 1.0
    is_near = np.abs(mine - theirs) <= TOLERANCE
    return float(1.0 - np.mean(is_near | (np.isnan(mine) & np.isnan(theirs))))


@contextmanager
def _quiet() -> Iterator[None]:
    """Torch's exporter warns of its own parts, and of torchvision, which is not needed; it prints to stdout as well."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings(), redirect_stdout(StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)
