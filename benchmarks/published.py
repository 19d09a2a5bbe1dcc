"""Fills the published table of docs/results.md: this project's networks by the protocols of the papers.

    radcam-depth import nuscenes DATAROOT scenes/ --version v1.0-test --images keyframes
    python -m benchmarks.published --bags scenes/ --json published.json

Networks whose weights are shipped are measured; --network NAME=FILE takes others, such as `cafnet` once it is trained.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from radcam_depth_ros.bags import find_bags
from radcam_depth_ros.cli.terminal.options import progress_bar, write_json
from radcam_depth_ros.drive import DriveSettings
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.evaluation.measures.protocols import PROTOCOLS
from radcam_depth_ros.evaluation.published import ALL, PublishedEvaluation, evaluate_published, published_drives
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.printable import printable

UNSTATED = "not stated"
RANGE = "80"


@dataclass(frozen=True)
class Row:
    """A line of the table.

    Attributes:
        method: What was published.
        protocol: By which protocol, of `PROTOCOLS`, or why by none of these.
        mae_m: Published MAE within 80 m on nuScenes' test frames, metres; None where none was published.
        network: This project's network of the method; empty where there is none.
    """

    method: str
    protocol: str
    mae_m: float | None
    network: str = ""

    def measured_by(self) -> str:
        """The protocol by which this project's network is measured for it."""
        return self.protocol if self.protocol in PROTOCOLS else "cafnet"


ROWS = (
    Row("RadarNet and FusionNet [Singh2023]", "singh2023", 2.179),
    Row("`baff` [Electronics2025]", "splits that exceed the data set", 2.053, "baff"),
    Row("`lircdepth`, distilled [Sun2025]", "cafnet", 2.009, "lircdepth"),
    Row("JustDepth [JustDepth2026]", "justdepth", 1.771),
    Row("`cafnet` with URDL [Sun2025]", "cafnet", 1.763, "cafnet"),
    Row("GET-UP [Sun2024b]", UNSTATED, 1.632),
    Row("TacoDepth, plug-in [Wang2025]", UNSTATED, 1.492),
    Row("POLAR [Polar2026]", UNSTATED, 1.408),
    Row("`structured` [Li2023]", "810 and 40 scenes of its own", None, "structured"),
)
"""The published table."""


def markdown(figures: Mapping[str, Mapping[str, PublishedEvaluation]]) -> str:
    """The table with this project's figures, by network and protocol, where there are some."""
    lines = ["| method | protocol | MAE 80 m, published | MAE 80 m, ours |", "| --- | --- | --- | --- |"]
    for row in ROWS:
        ours = figures.get(row.network, {}).get(row.measured_by())
        value = ours.groups[ALL].as_json()[RANGE]["mae"] if ours is not None else None
        given, measured = (f"{number:.3f}" if number is not None else "" for number in (row.mae_m, value))
        lines.append(f"| {row.method} | {row.protocol} | {given} | {measured} |")
    return "\n".join(lines)


def measure(
    places: Sequence[Path], networks: Mapping[str, str], limit: int | None
) -> dict[str, dict[str, PublishedEvaluation]]:
    """Measures each network by each protocol.

    Args:
        places: Bags, or folders of some.
        networks: Weight files by the networks' names; empty for the shipped ones.
        limit: Of each bag at most so many frames.
    """
    figures: dict[str, dict[str, PublishedEvaluation]] = {}
    bags = find_bags(places)
    for name, file in networks.items():
        estimator = Estimator(EstimatorConfig(network=name, model_file=file))
        for protocol in PROTOCOLS.values():
            drives, frames = published_drives(bags, DriveSettings(), protocol, limit)
            with progress_bar() as progress:
                task = progress.add_task(f"{name}, {protocol.name}", total=frames)
                advance = partial(progress.advance, task)
                result = evaluate_published(drives, estimator.estimate, protocol, name, advance)
            figures.setdefault(name, {})[protocol.name] = result
    return figures


def shipped_networks() -> list[str]:
    """This project's networks in the table that come with weights."""
    return [row.network for row in ROWS if row.network and archive.shipped(row.network).exists()]


def main() -> None:
    """Measures, prints the table, and writes all figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bags", type=Path, nargs="+", required=True, help="imported scenes, or a folder of them")
    parser.add_argument("--json", help="write all figures to a file, - for stdout")
    parser.add_argument("--network", action="append", help="NAME, or NAME=FILE; repeat it for several")
    parser.add_argument("--limit", type=int, help="of each bag at most so many frames")
    options = parser.parse_args()
    named = options.network or shipped_networks()
    networks = {name: file for name, _, file in (text.partition("=") for text in named)}
    try:
        figures = measure(options.bags, networks, options.limit)
    except RadcamDepthError as error:
        parser.error(printable(str(error)))
    if options.json:
        values: dict[str, Any] = {
            name: {protocol: result.as_json() for protocol, result in by_protocol.items()}
            for name, by_protocol in figures.items()
        }
        write_json({"published": [vars(row) for row in ROWS], "ours": values}, options.json)
    if options.json != "-":
        print(markdown(figures))


if __name__ == "__main__":
    main()
