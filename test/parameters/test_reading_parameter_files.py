from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from radcam_depth_ros.parameters import (
    RENAMED,
    NodeConfig,
    ParameterError,
    ParameterFile,
    build_config,
    read_parameter_file,
)

CONFIG = Path(__file__).parents[2] / "config"
Read = Callable[[str], ParameterFile]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Reads a file of a text."""

    def read(text: str) -> ParameterFile:
        (tmp_path / "mine.yaml").write_text(text, encoding="utf-8")
        return read_parameter_file(tmp_path / "mine.yaml")

    return read


@pytest.mark.parametrize(
    "path", [*sorted(CONFIG.glob("node*.yaml")), *sorted((CONFIG / "sensors").glob("*.yaml"))], ids=str
)
def test_the_shipped_files_are_read(path: Path) -> None:
    file = read_parameter_file(path)
    (section,) = yaml.safe_load(path.read_text(encoding="utf-8")).values()
    assert {*file.values, *file.node_only} == section["ros__parameters"].keys()
    assert (build_config(file.values) == NodeConfig()) == (path.parent == CONFIG)
    assert file.node_only == (("autostart",) if path.name == "node_all.yaml" else ())


@pytest.mark.parametrize(
    ("text", "namespace"),
    [
        ("/**: {ros__parameters: {threads: 2}}", ""),
        ("/*: {ros__parameters: {threads: 2}}", ""),
        ("radcam_depth: {ros__parameters: {threads: 2}}", ""),
        ("/radcam_depth: {ros__parameters: {threads: 2}}", ""),
        ("/front/radcam_depth: {ros__parameters: {threads: 2}}", "/front"),
        ("front: {radcam_depth: {ros__parameters: {threads: 2}}}", "/front"),
        ("/front/**: {ros__parameters: {threads: 2}}", "/front"),
        ("/**/radcam_depth: {ros__parameters: {threads: 2}}", ""),
        ("{other: {ros__parameters: {rate: 1}}, /**: {ros__parameters: {threads: 2}}}", ""),
        ("/**: {ros__parameters: {threads: 1}}\nfront: {radcam_depth: {ros__parameters: {threads: 2}}}", "/front"),
    ],
)
def test_a_section_is_the_nodes_by_name_or_wildcard(read: Read, text: str, namespace: str) -> None:
    file = read(text)
    assert (file.values, file.namespace) == ({"threads": 2}, namespace)


def test_values_are_those_of_ros(read: Read) -> None:
    file = read("/**: {ros__parameters: {max_wait_s: 5e-2, max_hold_s: 1, radar_topics: [''], device: cpu}}")
    config = build_config(file.values)
    assert (config.frame_builder.pairing.max_wait_s, config.frame_builder.max_hold_s) == (0.05, 1.0)
    assert (config.frame_builder.radars, config.estimator.device) == ((), "cpu")


def test_what_a_running_node_alone_needs_is_set_apart(read: Read) -> None:
    quality = "qos_overrides: {/image: {subscription: {depth: 5}}}, qos_overrides./a.subscription.depth: 2"
    file = read(f"/**: {{ros__parameters: {{use_sim_time: true, autostart: false, {quality}, threads: 3}}}}")
    assert file.values == {"threads": 3}
    first, second = "qos_overrides./image.subscription.depth", "qos_overrides./a.subscription.depth"
    assert file.node_only == ("use_sim_time", "autostart", first, second)


def test_an_old_name_is_taken_and_named(read: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(RENAMED, "longest_wait_s", "max_wait_s")
    file = read("/**: {ros__parameters: {longest_wait_s: 0.3, threads: 2}}")
    assert (file.values, file.renamed) == ({"max_wait_s": 0.3, "threads": 2}, (("longest_wait_s", "max_wait_s"),))
    both = read("/**: {ros__parameters: {longest_wait_s: 0.3, max_wait_s: 0.2}}")
    assert both.values == {"max_wait_s": 0.2}


@pytest.mark.parametrize(
    ("text", "tokens"),
    [
        ("/**: {ros__parameters: {radar_topcs: [/r]}}", ("radar_topcs", "did you mean radar_topics?")),
        ("/**: {ros__parameters: {threads: 2, colour: red}}", ("colour", "config/node_all.yaml")),
        ("/**: {ros__parameters: {voxel_size: 2, max_z: 1}}", ("voxel_size, max_z", "another package")),
        ("ekf: {ros__parameters: {threads: 2}}", ("/ekf", "radcam_depth or /**")),
        ("{a: {ros__parameters: {}}, b: {c: {ros__parameters: {}}}}", ("/a, /b/c", "radcam_depth or /**")),
        ("{/a/radcam_depth: {ros__parameters: {}}, /b/radcam_depth: {ros__parameters: {}}}", ("several nodes",)),
        ("image_topic: /front/image_raw", ("ros__parameters",)),
        ("/**: {ros__parameters: [1]}", ("must be a mapping", "list")),
        ("just words", ("mapping", "str")),
        ("", ("mapping", "NoneType")),
        ("/**: {ros__parameters: {", ("cannot read",)),
    ],
)
def test_what_is_not_the_nodes_is_refused_in_one_sentence(read: Read, text: str, tokens: tuple[str, ...]) -> None:
    with pytest.raises(ParameterError) as caught:
        read(text)
    assert all(token in str(caught.value) for token in ("mine.yaml", *tokens))
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"missing\.yaml"):
        read_parameter_file(tmp_path / "missing.yaml")


@pytest.mark.parametrize(
    ("name", "near"), [("radar_topcs", "did you mean radar_topics"), ("xyzzy", "it has allow_exported, autostart")]
)
def test_an_unknown_parameter_names_the_nearest(name: str, near: str) -> None:
    values: dict[str, Any] = {name: 1}
    with pytest.raises(ParameterError, match=near):
        build_config(values)


@pytest.mark.parametrize("value", ["infinity", float("inf")])
def test_the_word_for_the_sky_is_read_as_ros_reads_it(value: object) -> None:
    assert build_config({"sky": value}).output.sky == "infinity"
