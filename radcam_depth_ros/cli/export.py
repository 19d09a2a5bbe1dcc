"""`radcam-depth export`: writes a network with its weights to one TorchScript file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from radcam_depth_ros.cli.terminal.options import NETWORK, ModelOption, NetworkOption, keep_apart
from radcam_depth_ros.printable import printable


def export(
    out: Annotated[Path, typer.Argument(help="File to write, .pt by custom.")],
    network: NetworkOption = None,
    model: ModelOption = None,
) -> None:
    """Writes a network, its weights and its card to one file, for a C++ program, or the node with `allow_exported`.

    Example: radcam-depth export out/baff.pt --network baff
    """
    from radcam_depth_ros.networks.weights_io import archive, torchscript

    keep_apart((out,), (model,))
    torchscript.export(archive.load(model or network or NETWORK), out)
    typer.echo(printable(f"wrote {out}, {out.stat().st_size / 1e6:.1f} MB"), err=True)
