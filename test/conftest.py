"""What all tests share: an own ROS domain for each worker, the real drives, small drives made by hand, a fake node."""

from __future__ import annotations

import gc
import hashlib
import importlib
import os
import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import pytest
import torch
from fake_node import FakeNode
from small_drive import CAMERA_FROM_RADAR, START_NS, small_messages

from radcam_depth_ros import networks
from radcam_depth_ros.bags import BagMessage, BagReader, BagWriter, factory
from radcam_depth_ros.messages import StampedTransform, encode_transforms
from radcam_depth_ros.networks.interface import Network
from radcam_depth_ros.networks.weights_io import archive, torchscript

# The environment of the nodes in the tests: nothing leaves this machine, and parallel workers do not hear each other.
_WORKER = int("".join(filter(str.isdigit, os.environ.get("PYTEST_XDIST_WORKER", "0"))) or "0")
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(60 + _WORKER)

with warnings.catch_warnings(), suppress(ImportError):
    # ROS's generator loads a parser that imports a deprecated module, once, with the first message.
    warnings.simplefilter("ignore", DeprecationWarning)
    importlib.import_module("rosidl_generator_py")

REAL_DRIVES = Path(__file__).parents[2] / "shared" / "data"

SLOW_FIXTURES = {"context", "number_format", "record", "small_structured", "small_weights", "start_apart"}
"""Tests that ask for one of these are slow: a live node, a simulated drive, a network that is made ready to run."""
SLOW_PLACES = (
    "networks/test_networks.py",
    "training/distributed/test_processes.py",
    "training/test_every_network.py",
    "experiments/test_systems.py",
    "benchmarks/test_node_rate.py",
    "experiments/test_ablation.py",
    "benchmarks/test_fuzz.py",
    "cli/test_bench_verb.py",
    "demo/test_demo.py",
    "test_estimator.py",
    "training/test_backbones.py",
    "training/losses/test_distillation.py",
    "training/test_fit.py",
    "training/test_initial.py",
    "training/data/test_rehearsal.py",
    "training/test_teacher.py",
    "training/test_train_verb.py",
    "node/test_process.py",
    "simulation/test_recorded_drive.py",
    "simulation/test_simulate_verb.py",
    "simulation/world/test_world.py",
    "networks/layers/test_number_formats.py",
    "drive/test_accumulation.py",
    "drive/test_bad_drives.py",
    "engine/test_engine.py",
    "benchmarking/test_measurement.py",
    "cli/test_cli.py",
    "evaluation/test_evaluate_command.py",
    "networks/weights_io/test_archive.py",
    "benchmarks/test_contention.py",
    "benchmarks/test_adversary.py",
    "fleet/test_on_ray.py",
    "fleet/test_merging.py",
    "fleet/test_storage.py",
    "fleet/test_kills.py",
)
"""Folders and files whose tests are slow, those first that take longest."""


PLACES_OF_FREEZING = ("benchmarking", "engine", "networks", "weights_io")
"""Folders whose tests try how a network is made ready to run, or how long that takes and what memory it needs."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks what is slow, and brings its files to the front: no worker has a long one left when all else is done."""
    places: dict[str, int] = {}
    for item in items:
        place = _place_among_slow(item)
        if place < len(SLOW_PLACES) + 1:
            item.add_marker("slow")
        file = item.nodeid.partition("::")[0]
        places[file] = min(place, places.get(file, place))
    items.sort(key=lambda item: places[item.nodeid.partition("::")[0]])


def _place_among_slow(item: pytest.Item) -> int:
    path = item.path.relative_to(Path(__file__).parent)
    parts = {str(path), *map(str, path.parents)}
    listed = [index for index, place in enumerate(SLOW_PLACES) if place in parts]
    is_costly = not SLOW_FIXTURES.isdisjoint(getattr(item, "fixturenames", ()))
    return min(listed, default=len(SLOW_PLACES) + (not is_costly))


@pytest.fixture(scope="session", autouse=True)
def _quiet_machine(tmp_path_factory: pytest.TempPathFactory) -> None:
    """ROS logs to a temporary folder; one thread for torch, so that results do not depend on the machine's load."""
    os.environ["ROS_LOG_DIR"] = str(tmp_path_factory.mktemp("ros_log"))
    os.environ["OMP_NUM_THREADS"] = "1"  # in processes that tests start; their threads would wait for a core, spinning
    torch.set_num_threads(1)


@pytest.fixture(autouse=True)
def _one_thread_again() -> Iterator[None]:
    """One thread for the next test, whatever this one set."""
    yield
    if torch.get_num_threads() != 1:
        torch.set_num_threads(1)


@pytest.fixture(scope="session")
def frozen() -> dict[bytes, torch.jit.ScriptModule]:
    """Networks that are ready to run, by their weights, architecture and number format."""
    return {}


@pytest.fixture(scope="module", autouse=True)
def _frozen_once(request: pytest.FixtureRequest, frozen: dict[bytes, torch.jit.ScriptModule]) -> Iterator[None]:
    """Freezes each network once for all tests but those of freezing: it takes longer than most of what they try."""
    if request.path.parent.name in PLACES_OF_FREEZING:
        yield
        return
    freeze = torchscript.freeze

    def frozen_once(network: torch.nn.Module, dtype: torch.dtype = torch.float32) -> torch.jit.ScriptModule:
        if not isinstance(network, Network):
            return freeze(network, dtype)
        made_of = hashlib.sha256(f"{type(network)} {network.config} {dtype}".encode())
        for name, value in network.state_dict().items():
            made_of.update(name.encode())
            made_of.update(value.numpy().tobytes())
        key = made_of.digest()
        if key not in frozen:
            frozen[key] = freeze(network, dtype)
        return frozen[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(torchscript, "freeze", frozen_once)
        yield


@pytest.fixture(scope="module", autouse=True)
def _few_objects_to_collect() -> None:
    """Many tests collect garbage by hand: half a second each time, were modules and tests looked through as well."""
    gc.collect()
    gc.freeze()


@pytest.fixture(params=["float32", "bfloat16"])
def number_format(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Runs a test once in each number format, wherever `precision: auto` is taken, in other processes as well."""
    monkeypatch.setenv("RADCAM_DEPTH_PRECISION", request.param)
    return str(request.param)


@pytest.fixture(scope="session")
def astyx_val() -> Path:
    """A real drive, which is not part of this project."""
    return _real_drive("astyx_val")


def _real_drive(name: str) -> Path:
    path = REAL_DRIVES / name
    if not path.exists():
        pytest.skip(f"the real drive {name} is not on this machine")
    return path


@pytest.fixture(scope="session")
def write_drive() -> Callable[..., Path]:
    """Writes a drive of 96 x 64 pixels: `write_drive(path, frames=5, without=("/radar/points",))`."""

    def write(path: Path, frames: int = 5, without: Collection[str] = ()) -> Path:
        transform = encode_transforms(factory, [StampedTransform("camera", "radar", START_NS, CAMERA_FROM_RADAR)])
        with BagWriter(path) as writer:
            if "/tf_static" not in without:
                writer.write("/tf_static", transform, START_NS - 200_000_000, "tf2_msgs/msg/TFMessage")
            for index in range(frames):
                for topic, type_name, message, time_ns in small_messages(factory, index):
                    if topic not in without:
                        writer.write(topic, message, time_ns, type_name)
        return path

    return write


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Sequence[BagMessage]:
    """Three frames of the small drive: radar, image, camera_info and exact depth, every 100 ms."""
    path = tmp_path_factory.mktemp("recorded") / "drive.mcap"
    with BagWriter(path) as writer:
        for index in range(3):
            for topic, type_name, message, time_ns in small_messages(factory, index):
                writer.write(topic, message, time_ns, type_name)
    with BagReader(path) as reader:
        return tuple(reader.messages())


@pytest.fixture
def fake_node() -> FakeNode:
    """Keeps what is published, in place of rclpy's."""
    return FakeNode()


@pytest.fixture(scope="session")
def small_structured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small `structured` with random weights, which tells classes."""
    torch.manual_seed(4)
    small = {"backbone": "resnet18", "joined_channels": 16, "radar_channels": [4, 4, 4, 4, 4]}
    network = networks.create("structured", small)
    path = tmp_path_factory.mktemp("weights") / "structured.safetensors"
    archive.save(network, archive.Card.of(network, "structured", "nothing"), path)
    return path


@pytest.fixture(scope="session")
def small_weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A `baff` with random weights whose returns win pixels."""
    torch.manual_seed(3)
    network = networks.create("baff", {"threshold": 0.01})
    with torch.no_grad():
        network.get_parameter("association.point_head.bias").add_(3.0)
    path = tmp_path_factory.mktemp("weights") / "baff.safetensors"
    archive.save(network, archive.Card.of(network, "baff", "nothing"), path)
    return path
