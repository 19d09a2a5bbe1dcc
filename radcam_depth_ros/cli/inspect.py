"""`radcam-depth inspect`: what a bag holds for this package."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

from radcam_depth_ros.cli.options import Bag, JsonOption, write_json

if TYPE_CHECKING:
    from radcam_depth_ros.bags import BagReader


def inspect(bag: Bag, json_target: JsonOption = None) -> None:
    """Lists a bag's topics with their rates, and which of them would be taken for camera, radars and ground truth.

    Example: radcam-depth simulate out/seen --seed 7 --frames 20 && radcam-depth inspect out/seen
    """
    from radcam_depth_ros.bags import BagReader

    with BagReader(bag) as reader:
        seconds = reader.duration_ns / 1e9
        roles, missing = _roles(reader)
        rows: list[dict[str, Any]] = [
            {
                "topic": topic.name,
                "type": topic.type_name,
                "messages": topic.count,
                "hz": round((topic.count - 1) / seconds, 2) if topic.count > 1 and seconds > 0 else None,
                "role": roles.get(topic.name, ""),
            }
            for topic in sorted(reader.topics, key=lambda topic: topic.name)
        ]
    if json_target is not None:
        write_json({"bag": str(bag), "seconds": seconds, "topics": rows, "missing": missing}, json_target)
        return
    table = Table(title=f"{bag}, {seconds:.1f} s")
    for column in ("topic", "type", "messages", "hz", "taken for"):
        table.add_column(column)
    for row in rows:
        table.add_row(row["topic"], row["type"], str(row["messages"]), str(row["hz"] or ""), row["role"])
    console = Console()
    console.print(table)
    if missing:
        console.print(f"cannot be replayed: {missing}")


def _roles(reader: BagReader) -> tuple[dict[str, str], str]:
    """Topic to role, and what is missing for a replay."""
    from radcam_depth_ros.bags import BagError
    from radcam_depth_ros.bags.topics import find_topics

    try:
        found = find_topics(reader.topics)
    except BagError as error:
        return {}, str(error)
    roles: dict[Any, str] = {
        found.image: "camera",
        found.camera_info: "camera_info",
        found.lidar: "ground truth (LiDAR)",
        found.depth: "ground truth (depth)",
        found.classes: "classes",
        found.odometry: "odometry",
        found.tf_static: "transforms",
    }
    roles.update(dict.fromkeys(found.radars, "radar"))
    roles.pop(None, None)
    return roles, ""
