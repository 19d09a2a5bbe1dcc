"""Parses the options of `radcam-depth bench`."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import yaml

from radcam_depth_ros.benchmarking.comparison import Against
from radcam_depth_ros.benchmarking.subject import Subject
from radcam_depth_ros.drive import read_samples
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.networks import registry
from radcam_depth_ros.networks.weights_io import archive

PAPER = "paper"
PAPER_IMAGE_FACTOR = 2
"""A paper's network works on the image as it is; at the usual focal length ours sees half of its rows and columns."""


def parse_size(text: str) -> tuple[int, int]:
    """Height and width of `448x800`; RadcamDepthError for anything else."""
    found = re.fullmatch(r"([1-9]\d*)x([1-9]\d*)", text)
    if not found:
        raise RadcamDepthError(f"a size is HEIGHTxWIDTH in pixels, for example 448x800, got {text!r}")
    return int(found.group(1)), int(found.group(2))


def parse_count(text: str) -> int:
    """A whole number that is not negative; RadcamDepthError for anything else."""
    if not text.strip().isdigit():
        raise RadcamDepthError(f"a number of radar points is a whole number such as 60, got {text!r}")
    return int(text)


def parse_against(spec: str, subject: Subject) -> Against:
    """The other configuration: what `spec` says, and for the rest as `subject`."""
    try:
        # Names and values as in a card: YAML knows its numbers, words and lists.
        text = spec.replace("=", ": ").replace("(", "[").replace(")", "]")
        values: Any = yaml.safe_load(f"{{{text}}}")
    except yaml.YAMLError:
        values = None
    if not values or any(value is None and key != PAPER for key, value in values.items()):
        raise RadcamDepthError(
            f"--against takes `paper` or key=value pairs with commas between, such as 'precision=float32,mode=eager', "
            f"got {spec!r}"
        )
    is_paper = PAPER in values and values.pop(PAPER) is None
    architecture: dict[str, Any] = dict(subject.architecture)
    if is_paper:
        network = registry.find(_network_name(subject))
        if network.paper_network:
            subject, architecture = replace(subject, network=network.paper_network, model_file=""), {}
        elif not network.paper:
            raise RadcamDepthError(f"the network {subject.network} has no paper's form; say what should differ")
        architecture.update(network.paper)
        values = {"mode": "eager", "precision": "float32", **values}
    height_width = parse_size(str(values.pop("size"))) if "size" in values else None
    points = parse_count(str(values.pop("points"))) if "points" in values else None
    how: dict[str, Any] = {
        name: str(values.pop(name, getattr(subject, name))) for name in ("precision", "mode", "runtime")
    }
    other = replace(subject, architecture={**architecture, **values}, **how)
    return Against(spec, other, PAPER_IMAGE_FACTOR if is_paper else 1, height_width, points)


def _network_name(subject: Subject) -> str:
    return archive.load(subject.model_file).card.network if subject.model_file else subject.network


def with_frames(against: Against | None, bag: Path, limit: int | None) -> Against:
    """A comparison that takes a bag's frames as well."""
    if against is None:
        raise RadcamDepthError(
            "--bag is for comparing two precisions, got no --against; give --against precision=float32, for example"
        )
    return replace(against, samples=islice(read_samples(bag), limit))
