"""`radcam-depth export`: writes a network with its weights to one TorchScript or ONNX file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from radcam_depth_ros.cli.terminal.options import NETWORK, ModelOption, NetworkOption, keep_apart
from radcam_depth_ros.printable import printable

SIZE = "448x800"


def export(
    out: Annotated[Path, typer.Argument(help="File to write: .onnx for ONNX, otherwise TorchScript, .pt by custom.")],
    network: NetworkOption = None,
    model: ModelOption = None,
    size: Annotated[
        str | None,
        typer.Option(
            help="Of .onnx: HEIGHTxWIDTH of the image that the network sees, rounded up to multiples of 32.",
            show_default=SIZE,
        ),
    ] = None,
    opset: Annotated[int | None, typer.Option(help="Of .onnx: version of the operators.", show_default="18")] = None,
) -> None:
    """Writes a network, its weights and its card to one file, for a C++ program, or the node with `allow_exported`.

    An .onnx file is compared with its network before it gets its name, and needs the extra `onnx`.

    Example: radcam-depth export out/baff.pt --network baff
    """
    from radcam_depth_ros.frame import RadcamDepthError
    from radcam_depth_ros.networks.weights_io import archive, torchscript

    keep_apart((out,), (model,))
    source = model or network or NETWORK
    if out.suffix.lower() == ".onnx":
        _export_onnx(out, source, size or SIZE, opset)
    elif size is not None or opset is not None:
        raise RadcamDepthError(
            f"--size and --opset are for .onnx files, got {out.name}; a TorchScript file takes images of any size: "
            "leave them out, or name an .onnx file"
        )
    else:
        torchscript.export(archive.load(source), out)
    typer.echo(printable(f"wrote {out}, {out.stat().st_size / 1e6:.1f} MB"), err=True)


def _export_onnx(out: Path, source: Path | str, size: str, opset: int | None) -> None:
    from radcam_depth_ros.benchmarking.subject import Size
    from radcam_depth_ros.cli.terminal.bench_request import parse_size
    from radcam_depth_ros.networks.weights_io import archive, onnx_export

    onnx_export.require_packages()
    image = Size.padded(*parse_size(size), points=0)
    loaded = archive.load(source)
    typer.echo(
        printable(f"exporting {loaded.card.network} for images of {image.height} x {image.width}: minutes"), err=True
    )
    onnx_export.export(loaded, out, image.height, image.width, opset or onnx_export.OPSET)
