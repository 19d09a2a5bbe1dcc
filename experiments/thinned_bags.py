"""Copies bags with few radar returns: regions decode each return apart, and no memory holds a thousand of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from radcam_depth_ros.bags import BagReader, BagWriter, find_topics


def thinned_bags(bags: Sequence[Path], folder: Path, returns: int) -> tuple[Path, ...]:
    """Copies of bags with no more than `returns` returns an image, the same ones each time; written once.

    Args:
        bags: The bags.
        folder: Where the copies are, by number of returns.
        returns: Shared by all radars of a bag.
    """
    targets = [folder / str(returns) / f"{index}_{bag.stem}.mcap" for index, bag in enumerate(bags)]
    for bag, target in zip(bags, targets, strict=True):
        if not target.exists():
            _copy(bag, target, returns)
    return tuple(targets)


def _copy(source: Path, target: Path, returns: int) -> None:
    with BagReader(source) as reader, BagWriter(target) as writer:
        radars = find_topics(reader.topics).radars
        generator = np.random.default_rng(0)
        for message in reader.messages():
            if message.topic in radars:
                cloud = thinned_cloud(message.message, max(1, returns // len(radars)), generator)
                writer.write(message.topic, cloud, message.log_time_ns, message.type_name)
            else:
                writer.copy(message)


def thinned_cloud(cloud: Any, count: int, generator: np.random.Generator) -> Any:
    """A PointCloud2 with no more than `count` of its points, in their order."""
    rows = np.asarray(cloud.data).reshape(cloud.height, cloud.row_step)[:, : cloud.width * cloud.point_step]
    points = rows.reshape(-1, cloud.point_step)
    kept = np.sort(generator.permutation(len(points))[:count])
    data = np.ascontiguousarray(points[kept]).ravel()
    return dataclasses.replace(cloud, height=1, width=len(kept), row_step=data.size, data=data)
