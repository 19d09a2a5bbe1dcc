"""`radcam-depth networks`: lists the networks."""

from __future__ import annotations

from typing import Any

from radcam_depth_ros.cli.terminal.options import JsonOption, write_json
from radcam_depth_ros.reporting.terminal import PlainConsole, print_table


def networks(json_target: JsonOption = None) -> None:
    """Lists the networks, their size, and what the weights that come with them were trained on.

    Example: radcam-depth networks --json -
    """
    from radcam_depth_ros.networks import registry

    entries = [_entry(name) for name in registry.names()]
    if json_target is not None:
        write_json(entries, json_target)
        return
    rows = []
    for entry in entries:
        trained_on = entry["training_data"] if entry["weights"] else entry["get"]
        rows.append((entry["name"], entry["about"], f"{entry['parameters'] / 1e6:.2f} M", trained_on))
    columns = ("name", "what it is", "parameters", "its weights were trained on")
    print_table(PlainConsole(), "networks", columns, rows, justify="left")


def _entry(name: str) -> dict[str, Any]:
    from radcam_depth_ros.networks import registry
    from radcam_depth_ros.networks.weights_io import archive

    has_weights = archive.shipped(name).is_file()
    loaded = archive.load(name) if has_weights else None
    network = loaded.network if loaded else registry.create(name)
    return {
        "name": name,
        "about": registry.find(name).about,
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
        "weights": has_weights,
        "training_data": loaded.card.training_data if loaded else "",
        "metrics": loaded.card.metrics if loaded else {},
        "get": "" if loaded else archive.how_to_get(name),
        "train": f"radcam-depth train --network {name} --bags drives/ --out runs/{name}",
    }
