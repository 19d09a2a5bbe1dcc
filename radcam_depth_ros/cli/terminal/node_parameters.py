"""The node's parameters for verbs that read bags: from a parameter file, and from options, which win over it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

# What is heavy to import is imported where it is used: --help answers at once.
from radcam_depth_ros.printable import printable

if TYPE_CHECKING:
    from radcam_depth_ros.drive import DriveSettings, TopicChoice
    from radcam_depth_ros.parameters import NodeConfig, ParameterFile

ParamsOption = Annotated[
    Path | None,
    typer.Option(
        "--params",
        help="The node's parameter file, such as inspect --write-params writes it: topics, frames, time offsets, "
        "extrinsics, sweeps, network. Options that are given besides win over it.",
    ),
]
OUTPUT = ("output.", "estimator.output_size")
"""Fields of the node's config that say how depth is written."""
INFERENCE = (
    *("estimator.model_file", "estimator.allow_exported", "estimator.trusted_models"),
    *("estimator.device", "estimator.precision", "estimator.runtime", "estimator.threads"),
)
"""Fields of the node's config that say how depth is estimated, besides the network's name."""
_QOS = "qos_overrides."


@dataclass(frozen=True)
class NodeParameters:
    """The parameters that a file and options set.

    Attributes:
        config: The node's config.
        topics: The topics that they name.
    """

    config: NodeConfig
    topics: TopicChoice

    def drive_settings(self, **settings: Any) -> DriveSettings:
        """How bags are read; `settings` are fields of `DriveSettings` that no parameter sets."""
        from radcam_depth_ros.drive import DriveSettings

        return DriveSettings(frame_builder=self.config.frame_builder, topics=self.topics, **settings)


def node_parameters(
    params: Path | None,
    given: Mapping[str, Any],
    unused: Iterable[str] = (),
    *,
    lidar: str | None = None,
    depth: str | None = None,
) -> NodeParameters:
    """What a parameter file and options say, judged together as the node does.

    Args:
        params: The parameter file; None for none.
        given: Options by the parameter that each stands for; None where an option is not given.
        unused: Fields of `NodeConfig`, or beginnings of them, that the verb has no use for: those that the file sets to
            other values than the default are named on stderr.
        lidar: Topic of the LiDAR, which no parameter names.
        depth: Topic of the exact depth images, which no parameter names.

    Raises:
        RadcamDepthError: for a file that is not the node's, or a value, or values together, that cannot be used.
    """
    from radcam_depth_ros.drive import TopicChoice
    from radcam_depth_ros.parameters import build_config, read_parameter_file

    options = {name: value for name, value in given.items() if value is not None}
    file = None if params is None else read_parameter_file(params)
    values = dict(file.values) if file is not None else {}
    named: dict[str, Any] = {}
    if file is not None:
        for old, new in file.renamed:
            typer.echo(f"{printable(str(file.path))}: {old} is now called {new}; rename it", err=True)
        config = _of_file(file)
        _name_what_has_no_effect(file, tuple(unused))
        named = _named_topics(config, file.namespace)
    if "network" in options and "model_file" not in options:
        values.pop("model_file", None)
    if "image_topic" in options:
        # The option is the topic itself, whatever its type, with the calibration beside it.
        values = {name: value for name, value in values.items() if name not in ("image_transport", "camera_info_topic")}
        named |= {"image": options["image_topic"], "camera_info": None, "is_compressed": False}
    if "radar_topics" in options:
        named["radars"] = tuple(options["radar_topics"])
    elif "camera_from_radar" in options and "radar_topics" not in values:
        # Radars that are yet to be found: as many as there are extrinsics.
        values["radar_topics"] = [f"radar_{index}" for index in range(len(options["camera_from_radar"]) // 7)] or [""]
    if "odometry_topic" in options:
        named["odometry"] = options["odometry_topic"]
    return NodeParameters(build_config({**values, **options}), TopicChoice(**named, lidar=lidar, depth=depth))


def _of_file(file: ParameterFile) -> NodeConfig:
    from radcam_depth_ros.frame import RadcamDepthError
    from radcam_depth_ros.parameters import ParameterError, build_config

    try:
        return build_config(file.values)
    except RadcamDepthError as error:
        raise ParameterError(f"{file.path}: {error}") from error


def _named_topics(config: NodeConfig, namespace: str) -> dict[str, Any]:
    """Fields of `TopicChoice`: the node's default names are taken where they are there, all others are asked for."""
    from radcam_depth_ros.parameters import NODE_NAME, NodeConfig

    def full(name: str) -> str:
        if name.startswith("~"):
            return f"{namespace}/{NODE_NAME}{name[1:]}"
        return name if name.startswith("/") else f"{namespace}/{name}"

    usual, given = NodeConfig().frame_builder, config.frame_builder
    image, radars = full(config.image_topic), tuple(full(topic) for topic in given.radars)
    is_usual_image, are_usual_radars = given.image == usual.image, given.radars == usual.radars
    return {
        "image": None if is_usual_image else image,
        "camera_info": full(given.camera_info) if given.camera_info else None,
        "radars": None if are_usual_radars else radars,
        "odometry": full(given.odometry) if given.odometry else "",
        "preferred": ((image,) if is_usual_image else ()) + (radars if are_usual_radars else ()),
        "is_compressed": config.is_compressed,
    }


def _name_what_has_no_effect(file: ParameterFile, unused: tuple[str, ...]) -> None:
    from radcam_depth_ros.parameters import PARAMETERS

    given = [spec for spec in PARAMETERS if spec.name in file.values and spec.path.startswith(unused)]
    changed = [spec.name for spec in given if spec.convert(file.values[spec.name]) != spec.default]
    of_nodes = [f"{_QOS}*" if name.startswith(_QOS) else name for name in file.node_only]
    idle = dict.fromkeys((*of_nodes, *changed))
    if idle:
        typer.echo(printable(f"{file.path}: without effect here: {', '.join(idle)}"), err=True)
