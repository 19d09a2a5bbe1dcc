from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from rclpy.node import Node
from rclpy.parameter import Parameter

from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.node.parameters import TYPES, Parameters, describe
from radcam_depth_ros.parameters import PARAMETERS, RENAMED, NodeConfig, ParameterError, ParameterKind, ParameterSpec

NODE_YAML = Path(__file__).parents[2] / "config" / "node_all.yaml"
BY_NAME = {spec.name: spec for spec in PARAMETERS}


def field_paths(config: Any, prefix: str = "") -> Iterator[str]:
    for entry in dataclasses.fields(config):
        value = getattr(config, entry.name)
        if dataclasses.is_dataclass(value):
            yield from field_paths(value, f"{prefix}{entry.name}.")
        else:
            yield f"{prefix}{entry.name}"


def plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def test_each_field_has_one_parameter() -> None:
    assert sorted(spec.path for spec in PARAMETERS) == sorted(field_paths(NodeConfig()))
    assert len(BY_NAME) == len(PARAMETERS)


@pytest.mark.parametrize("spec", PARAMETERS, ids=lambda spec: spec.name)
def test_each_parameter_is_described_and_its_default_is_allowed(spec: ParameterSpec) -> None:
    assert spec.info.description.endswith(".")
    assert spec.convert(plain(spec.default)) == spec.default
    descriptor = describe(spec)
    assert descriptor.description == spec.info.description
    assert bool(descriptor.additional_constraints) == bool(spec.info.choices)
    if spec.kind in (ParameterKind.DOUBLE, ParameterKind.INTEGER):
        assert descriptor.floating_point_range or descriptor.integer_range


def test_the_shipped_file_gives_the_defaults_and_describes_each() -> None:
    text = NODE_YAML.read_text(encoding="utf-8")
    (parameters,) = [section["ros__parameters"] for section in yaml.safe_load(text).values()]
    qos = {name for name in parameters if name.startswith("qos_overrides")}
    assert {name: value for name, value in parameters.items() if name not in qos} == {
        spec.name: plain(spec.default) for spec in PARAMETERS if spec.default is not None
    }
    before = ""
    for line in text.splitlines():
        if line.strip().split(":")[0] in parameters:
            assert before.strip().startswith("#"), f"{line.strip()} lacks a comment"
        before = line


def test_the_shipped_file_is_read_by_ros(context: Any) -> None:
    node = Node("radcam_depth", context=context, cli_args=["--ros-args", "--params-file", str(NODE_YAML)])
    assert Parameters(node).read() == NodeConfig()
    node.destroy_node()


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("max_wait_s", 1, 1.0),
        ("max_wait_s", 0.25, 0.25),
        ("threads", 3, 3),
        ("camera_from_radar", [1, 2, 3, 0, 0, 0, 1], (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)),
        ("radar_topics", ["a", "b"], ("a", "b")),
        ("radar_time_offset_s", 1, 1.0),
        ("radar_time_offset_s", [0.25], (0.25,)),
        ("radar_time_offset_s", [], 0.0),
        ("radar_frame", "front", "front"),
        ("radar_frame", ["front"], ("front",)),
        ("radar_frame", [""], ("",)),
        ("radar_fields", ["rcs=power"], ("rcs=power",)),
        ("radar_topics", [""], ()),
        ("image_transport", "compressed", "compressed"),
        ("autostart", False, False),
    ],
)
def test_a_file_may_give(context: Any, name: str, value: Any, expected: Any) -> None:
    node = Node("radcam_depth", context=context, parameter_overrides=[Parameter(name, value=value)])
    config = Parameters(node).read()
    assert functools.reduce(getattr, BY_NAME[name].path.split("."), config) == expected
    node.destroy_node()


def test_an_old_name_is_taken_with_a_warning(context: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(RENAMED, "longest_wait_s", "max_wait_s")
    for given, expected in (({"longest_wait_s": 0.3}, 0.3), ({"longest_wait_s": 0.3, "max_wait_s": 0.2}, 0.2)):
        warnings: list[str] = []
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        node = Node("radcam_depth", context=context, parameter_overrides=overrides)
        assert Parameters(node, warn=warnings.append).read().frame_builder.pairing.max_wait_s == expected
        assert not node.has_parameter("longest_wait_s")
        assert "longest_wait_s is now called max_wait_s" in warnings[0]
        node.destroy_node()


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("max_wait_s", "soon", "max_wait_s must be a number, got 'soon'"),
        ("max_wait_s", -1.0, "max_wait_s must be within 0 and 10, got -1"),
        ("max_wait_s", float("nan"), "max_wait_s must be within 0 and 10, got nan"),
        ("threads", 1.5, "threads must be a whole number, got 1.5"),
        ("threads", True, "threads must be a whole number, got True"),
        ("output_size", "big", "output_size must be one of native, network, got 'big'"),
        ("radar_topics", "radar", "radar_topics must be a list of texts, got 'radar'"),
        ("camera_from_radar", ["x"], "camera_from_radar must be a list of numbers, got ['x']"),
        ("camera_from_radar", [1.0, 2.0], "camera_from_radar needs x y z qx qy qz qw"),
        ("image_topic", "camera_info", "must be different topics"),
        ("preview_colormap", "pink", "preview_colormap must be one of turbo, jet, viridis"),
        ("points_stride", 0, "points_stride must be within 1 and 64, got 0"),
        ("points_near_m", 1000.0, "0 <= points_near_m < points_far_m, got 1000.0 and 1000.0"),
        ("radar_time_offset_s", "soon", "radar_time_offset_s must be a number, got 'soon'"),
        ("radar_time_offset_s", [0.0, 99.0], "radar_time_offset_s must be within -10 and 10, got 99.0"),
        ("radar_time_offset_s", [0.0, 0.1], "one value for all radars or one for each of 1, got 2: [0.0, 0.1]"),
        ("radar_frame", ["a", "b"], "radar_frame needs one value for all radars or one for each of 1, got 2"),
        (
            "radar_fields",
            "rsc=power",
            "as quantity=field, got 'rsc=power'; did you mean rcs?",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_in_a_file_and_when_set(
    context: Any, name: str, value: Any, sentence: str
) -> None:
    node = Node("radcam_depth", context=context, parameter_overrides=[Parameter(name, value=value)])
    with pytest.raises(RadcamDepthError) as caught:
        Parameters(node).read()
    assert sentence in str(caught.value)
    node.destroy_node()

    node = Node("radcam_depth", context=context)
    parameters = Parameters(node)
    if Parameter(name, value=value).type_ == TYPES[BY_NAME[name].kind]:
        (result,) = node.set_parameters([Parameter(name, value=value)])
        assert not result.successful
        assert sentence in result.reason or "out of range" in result.reason
    assert parameters.read() == NodeConfig()
    node.destroy_node()


def test_parameters_are_checked_together(context: Any) -> None:
    node = Node("radcam_depth", context=context)
    parameters = Parameters(node)
    near, far = Parameter("preview_near_m", value=100.0), Parameter("preview_far_m", value=200.0)
    assert "preview_near_m < preview_far_m" in node.set_parameters([near])[0].reason
    assert node.set_parameters_atomically([near, far]).successful
    assert parameters.read().output.preview_near_m == 100.0
    node.destroy_node()


def test_what_does_not_fit_what_else_is_set_is_refused(context: Any) -> None:
    node = Node("radcam_depth", context=context)
    parameters = Parameters(node)
    assert node.set_parameters([Parameter("without_radar", value="suppress")])[0].successful
    assert "no depth would ever come out" in node.set_parameters([Parameter("radar_topics", value=[""])])[0].reason
    both = [Parameter("radar_topics", value=[""]), Parameter("without_radar", value="hold")]
    assert node.set_parameters_atomically(both).successful
    assert parameters.read().frame_builder.without_radar == "hold"
    node.destroy_node()


ADJUSTABLE = {
    "camera_height_m": 1.2,
    "camera_pitch_deg": 1.0,
    "camera_roll_deg": 1.0,
    "max_time_offset_s": 0.2,
    "max_wait_s": 0.2,
    "max_sweep_age_s": 0.2,
    "depth_encoding": "16UC1",
    "preview_colormap": "grey",
    "preview_near_m": 3.0,
    "preview_far_m": 60.0,
    "points_stride": 4,
    "points_near_m": 1.0,
    "points_far_m": 40.0,
    "min_confidence": 0.2,
    "points_min_confidence": 0.3,
    "points_organized": True,
    "points_max_rate_hz": 2.0,
    "sky": "none",
    "without_radar": "hold",
    "max_hold_s": 0.2,
    "output_size": "network",
}


def test_while_they_are_frozen_only_what_is_adjustable_changes_and_who_uses_it_is_told(context: Any) -> None:
    assert {spec.name for spec in PARAMETERS if spec.info.is_live} == ADJUSTABLE.keys()
    told: list[tuple[str, ...]] = []
    node = Node("radcam_depth", context=context)
    parameters = Parameters(node, told.append)
    parameters.frozen_because = "it is busy"
    for name, value in ADJUSTABLE.items():
        assert node.set_parameters([Parameter(name, value=value)])[0].successful
    assert told == [(name,) for name in ADJUSTABLE]
    told.clear()
    both = [Parameter("network", value="cafnet"), Parameter("device", value="cuda"), Parameter("max_wait_s", value=0.3)]
    result = node.set_parameters_atomically(both)
    assert (result.successful, result.reason) == (False, "network and device cannot change now: it is busy")
    assert node.set_parameters([Parameter("network", value="baff")])[0].successful  # which it is
    assert "must be a text, got" in node.set_parameters([Parameter("radar_frame", value=3)])[0].reason
    assert told == [("network",)]
    read = parameters.read()
    assert (read.frame_builder.pairing.max_wait_s, read.estimator.output_size) == (0.2, "network")
    node.destroy_node()


def test_a_value_of_the_file_that_was_refused_can_be_mended(context: Any) -> None:
    node = Node("radcam_depth", context=context, parameter_overrides=[Parameter("output_size", value="big")])
    parameters = Parameters(node)
    with pytest.raises(ParameterError, match="output_size"):
        parameters.read()
    assert node.set_parameters([Parameter("threads", value=2)])[0].successful
    with pytest.raises(ParameterError, match="output_size"):
        parameters.read()
    assert node.set_parameters([Parameter("output_size", value="network")])[0].successful
    assert parameters.read().estimator.output_size == "network"
    node.destroy_node()


def test_autostart_is_the_file_s_alone(context: Any) -> None:
    node = Node("radcam_depth", context=context)
    Parameters(node)
    assert "read-only" in node.set_parameters([Parameter("autostart", value=False)])[0].reason
    node.destroy_node()


def test_what_is_of_each_radar_is_one_value_or_a_list(context: Any) -> None:
    node = Node("radcam_depth", context=context)
    parameters = Parameters(node)
    assert node.set_parameters([Parameter("radar_frame", value="radar")])[0].successful
    assert parameters.read().frame_builder.radar_frame == "radar"
    several = [
        Parameter("radar_topics", value=["/front", "/rear"]),
        Parameter("radar_frame", value=["", "rear"]),
        Parameter("radar_time_offset_s", value=[0.0, -0.05]),
        Parameter("radar_fields", value=["", "rcs=power"]),
    ]
    assert node.set_parameters_atomically(several).successful
    pipeline = parameters.read().frame_builder
    assert (pipeline.radar_frame, pipeline.pairing.radar_time_offset_s) == (("", "rear"), (0.0, -0.05))
    assert [aliases.rcs for aliases in pipeline.field_aliases()][1] == ("power",)
    assert "one for each of 1, got 2" in node.set_parameters([Parameter("radar_topics", value=["/front"])])[0].reason
    assert node.set_parameters([Parameter("radar_frame", value="both")])[0].successful
    node.destroy_node()
