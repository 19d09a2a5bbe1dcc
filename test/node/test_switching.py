"""Another network in a node that goes on running: deactivate, set `network` or `model_file`, activate."""

from __future__ import annotations

import gc
import threading
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from radcam_depth_ros import networks
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.messages import decode_classes
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.node import depth_node

CLASSES = "semantics/image"


@pytest.fixture(scope="module")
def lircdepth(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(5)
    network = networks.create("lircdepth")
    path = tmp_path_factory.mktemp("weights") / "lircdepth.safetensors"
    archive.save(network, archive.Card.of(network, "lircdepth", "nothing"), path)
    return path


def engine_parts(estimator: Estimator) -> list[weakref.ref[Any]]:
    """The estimator, and what it holds of the network."""
    return [weakref.ref(part) for part in (estimator, estimator._engine, estimator._engine._calls)]


@pytest.mark.timeout(400)  # three networks are scripted, on a machine that may be busy
def test_one_network_after_another_without_a_restart(
    start: Callable[..., Any],
    small_weights: Path,
    small_structured: Path,
    lircdepth: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(depth_node, "WARM_UP_SIZE", (96, 64))
    bench = start(Estimator, model_file=str(small_weights), precision="float32")
    classes: list[Any] = []
    bench.subscribe(CLASSES, "sensor_msgs/msg/Image", classes.append)
    bench.connect()
    bench.await_depth()
    assert "deactivate it first" in bench.set_parameter("model_file", str(small_structured))
    assert not bench.peer.count_publishers(CLASSES)
    threads = threading.active_count()
    topics = len(list(bench.node.publishers))
    for name, path in (("structured", small_structured), ("lircdepth", lircdepth)):
        old = engine_parts(bench.fake)
        assert bench.change_state("deactivate")
        assert bench.set_parameter("model_file", str(path)) == ""
        bench.fake = None
        bench.diagnostics.clear()
        assert bench.change_state("activate")
        assert bench.fake.card.network == name

        depth = bench.await_depth()
        tells = name == "structured"
        bench.until(
            lambda tells=tells: bool(bench.peer.count_publishers(CLASSES)) is tells, what="the topic of classes"
        )
        if tells:
            classes.clear()
            bench.send_until(lambda: classes, what="classes")
            message = classes[-1]
            assert (message.encoding, message.header.frame_id) == ("mono8", depth.header.frame_id)
            assert (message.width, message.height) == (depth.width, depth.height)
            assert decode_classes(message).classes.max() < 19
        bench.until(lambda name=name: bench.status("model", f"{name} ("), what="the network's name")
        bench.until(
            lambda name=name: any(f"active with {name} (" in log for log in bench.logs), what="a line in the log"
        )

        gc.collect()
        assert [part() for part in old] == [None, None, None]
        assert threading.active_count() == threads
        assert len(list(bench.node.publishers)) == topics + tells


def test_a_network_that_cannot_be_loaded_leaves_the_one_before(
    start: Callable[..., Any], make_estimator: Callable[..., Any], tmp_path: Path
) -> None:
    bench = start(lambda config: Estimator(config) if config.model_file else make_estimator(config))
    bench.connect()
    bench.await_depth()
    before = bench.fake
    assert bench.change_state("deactivate")
    assert bench.set_parameter("model_file", str(tmp_path / "nothing.safetensors")) == ""
    assert not bench.change_state("activate")
    assert bench.state == "inactive"
    status = bench.until(lambda: bench.status("model", "cannot be activated"), what="a line about the model")
    assert status.level == b"\x02"
    assert "no weight file at" in status.message
    assert "made up is still loaded" in status.message
    bench.until(lambda: [log for log in bench.logs if status.message in log])
    assert len([log for log in bench.logs if "cannot be activated" in log]) == 1

    assert bench.set_parameter("model_file", "") == ""
    bench.diagnostics.clear()
    assert bench.change_state("activate")
    assert bench.fake is before
    bench.await_depth()
    bench.until(lambda: bench.status("model", "made up"), what="the network's name")
    assert bench.diagnostics[-1]["model"].level == b"\x00"


def test_the_network_is_loaded_again_only_where_it_changed(
    start: Callable[..., Any], make_estimator: Callable[..., Any]
) -> None:
    loaded: list[EstimatorConfig] = []

    def make(config: EstimatorConfig) -> Any:
        loaded.append(config)
        return make_estimator(config)

    bench = start(make)
    bench.connect()
    bench.await_depth()
    assert bench.change_state("deactivate")
    assert bench.set_parameter("depth_encoding", "16UC1") == ""
    assert bench.change_state("activate")
    bench.send_until(lambda: bench.depth and bench.depth[-1].encoding == "16UC1", what="16UC1")
    assert loaded == [EstimatorConfig()]

    assert bench.change_state("deactivate")
    assert bench.set_parameter("image_topic", "a b") == ""
    assert not bench.change_state("activate")
    bench.until(lambda: bench.status("model", "expected the name of a topic"), what="a line about the topic")
    assert bench.set_parameter("image_topic", "image") == ""
    assert bench.set_parameter("network", "structured") == ""
    assert bench.change_state("activate")
    assert loaded == [EstimatorConfig(), EstimatorConfig(network="structured")]


def test_a_model_file_comes_before_the_network_s_name_and_the_log_says_so(start: Callable[..., Any]) -> None:
    bench = start(model_file="mine.safetensors")
    bench.connect()
    bench.await_depth()
    assert bench.change_state("deactivate")
    assert bench.set_parameter("network", "structured") == ""
    assert bench.change_state("activate")
    bench.until(lambda: any("network is now structured, but model_file comes first" in log for log in bench.logs))
