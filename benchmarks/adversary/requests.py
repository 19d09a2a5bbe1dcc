"""Requests to a live node, from two clients at once: each is answered, memory stays, and depth is right afterwards."""

from __future__ import annotations

import json
import os
import random
import re
import struct
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.adversary.cases import Outcome, Place, generator, same, text_problems
from benchmarks.adversary.good_files import write_good
from benchmarks.fuzz_messages import CAMERA_INFO, IMAGE, RADAR, TYPES, good
from benchmarks.memory import memory_mib
from demo.process import NodeProcess, keep_to_this_machine

LONGEST_CALLBACK_MS = 250.0
"""Limit on an idle machine, of all callbacks but transitions."""
_START_S, _PATIENCE_S, _AFTER_OTHERS_S = 300.0, 120.0, 5.0
_LATER_REQUESTS = 3
_MOST_GROWTH_MIB, _SETTLING_GOODS = 64.0, 3
_CALLBACKS = "callbacks.json"
_RADAR_IN_THE_CAMERA = [0.0, 0.0, 0.0, 0.5, -0.5, 0.5, 0.5]
_TRANSITIONS = ("configure", "activate", "deactivate", "cleanup", "activate", "deactivate", "no_such", "", "\x1b[2J")
_IMPOSSIBLE = (0, 10, 30, 60, 97, 255)
"""Transitions that nobody may ask for, by id; those that shut the node down are left out."""
_NUMBERS = (0, 1, -1, 2, 100, 2**31, 2**63 - 1, -(2**63))
_FLOATS = (0.0, 1.0, -1.0, 0.05, 1e300, float("nan"), float("inf"), 50.0)
_LARGE_TEXT = "a" * 100_000
_TEXTS = ("", "x", "/image", "hold", "16UC1", "\x1b[2J", _LARGE_TEXT, "../../etc/passwd", "turbo", "{", "\ud7ff")
_NAMES = ("", "no_such", "x" * 5000, "\x1b[2J", "qos_overrides./tf.subscription.depth", "a.b", "use_sim_time")


class RequestAttack:
    """Sends pairs of requests to a node, one from each of two clients.

    Args:
        seed: What they are made of.
        place: Where the node's files are.
    """

    good_every = 100
    is_inside = False

    def __init__(self, seed: int, place: Place) -> None:
        keep_to_this_machine()
        os.environ["ROS_LOG_DIR"] = str(place.outputs)
        self._seed, self._place = seed, place
        write_good(place.kept)
        # Outside of the tree that nobody may touch.
        self._files = place.folder.with_name(f"{place.folder.name}-node")
        self._files.mkdir()
        parameters = {
            "autostart": False,
            "model_file": str(place.kept / "good.pt"),
            "allow_exported": True,
            "threads": 1,
            "precision": "float32",
            "camera_from_radar": _RADAR_IN_THE_CAMERA,
            "camera_height_m": 1.5,
        }
        file = self._files / "node.yaml"
        file.write_text(yaml.safe_dump({"radcam_depth": {"ros__parameters": parameters}}), encoding="utf-8")
        self._log = self._files / "node.log"
        start = (sys.executable, "-m", "benchmarks.adversary.live_node", str(self._files / _CALLBACKS))
        self._process = NodeProcess(file, self._log, (*start, "--ros-args", "--params-file", str(file)))
        self._process.__enter__()
        self._expected, self._settled_mib = np.zeros(0), 0.0
        self._read = self._goods = 0
        self._clients = Clients(self._process)
        self._parameters = self._clients.parameters()
        problems = self.good()
        if problems:
            raise RuntimeError(f"the node gives no depth before any request: {'; '.join(problems)}")
        self._send_large_requests()

    @staticmethod
    def longest_ms(folder: Path) -> dict[str, float]:
        """The longest callbacks of the nodes that ran in a folder, by what was called."""
        longest: dict[str, float] = {}
        for file in folder.glob(f"*/{_CALLBACKS}"):
            for name, took_ms in json.loads(file.read_text(encoding="utf-8")).items():
                longest[name] = max(took_ms, longest.get(name, 0.0))
        return longest

    def run(self, number: int) -> Outcome:
        """Two requests at once."""
        rng = generator(self._seed, "requests", number)
        asked = [self._request(rng) for _ in range(2)]
        with self._place.watched() as problems:
            answers = self._clients.ask(asked)
        found = [f"no answer to {what}" for (what, _), answer in zip(asked, answers, strict=True) if answer is None]
        self._process.check()
        return Outcome(" beside ".join(what for what, _ in asked), "no answer" if found else "answered",
                       (*problems, *found, *self._logged()), memory_mib("VmHWM", self._process.pid))  # fmt: skip

    def good(self) -> tuple[str, ...]:
        """Sets all parameters back, configures and activates, and compares the depth of a pair."""
        problem = self._clients.start_anew(self._parameters)
        if problem:
            return (problem,)
        depth = self._clients.depth()
        if depth is None:
            return (f"no depth of a good pair within {_PATIENCE_S:.0f} s", *self._logged())
        now_mib = memory_mib("VmRSS", self._process.pid)
        if not self._expected.size:
            self._expected = depth
        problems = [] if same(depth, self._expected) else ["a good pair gives another depth"]
        self._goods += 1
        if self._goods <= _SETTLING_GOODS:
            self._settled_mib = now_mib
        elif now_mib > self._settled_mib + _MOST_GROWTH_MIB:
            problems.append(f"memory grew from {self._settled_mib:.0f} to {now_mib:.0f} MiB")
        return (*problems, *self._logged())

    def close(self) -> None:
        """Ends the node."""
        self._clients.close()
        self._process.__exit__(None, None, None)

    def _send_large_requests(self) -> None:
        """Has the node keep the buffers that large requests need, before its memory is watched."""
        from rclpy.parameter import Parameter

        given = [("no_such", Parameter("no_such", Parameter.Type.STRING_ARRAY, [_LARGE_TEXT] * 300))]
        for service in ("set_parameters", "set_parameters_atomically"):
            self._clients.ask([(service, partial(Clients.setting, service=service, given=given))] * 2)

    def _request(self, rng: random.Random) -> tuple[str, Callable[[Any], Any]]:
        """What is asked, and the call that makes the request of a service's class."""
        kind = rng.choices(("set", "set_atomically", "read", "transition", "state"), (50, 10, 20, 12, 8))[0]
        if kind in ("set", "set_atomically"):
            given = [self._parameter(rng) for _ in range(rng.choice((1, 1, 1, 2, 5, 30)))]
            service = "set_parameters" if kind == "set" else "set_parameters_atomically"
            return f"{service} {given[0][0][:30]!r}", lambda clients: clients.setting(service, given)
        if kind == "read":
            service = rng.choice(("get_parameters", "get_parameter_types", "describe_parameters", "list_parameters"))
            names = [rng.choice((*self._parameters, *_NAMES)) for _ in range(rng.choice((0, 1, 3, 500)))]
            return f"{service} of {len(names)}", lambda clients: clients.reading(service, names)
        if kind == "state":
            service = rng.choice(
                ("get_state", "get_available_states", "get_available_transitions", "get_transition_graph")
            )
            return service, lambda clients: clients.plain(service)
        label = rng.choice(_TRANSITIONS)
        number = rng.choice(_IMPOSSIBLE) if not label else rng.choice((0, 1, 255))
        return f"transition {label!r} {number}", lambda clients: clients.transition(label, number)

    def _parameter(self, rng: random.Random) -> tuple[str, Any]:
        """A name and a value that may be right, wrong or of another type."""
        from rclpy.parameter import Parameter

        kind = Parameter.Type
        name = rng.choice((*self._parameters, rng.choice(_NAMES)))
        values: tuple[tuple[Any, Any], ...] = (
            (kind.INTEGER, rng.choice(_NUMBERS)),
            (kind.DOUBLE, rng.choice(_FLOATS)),
            (kind.BOOL, rng.random() < 0.5),
            (kind.STRING, rng.choice(_TEXTS)),
            (kind.STRING_ARRAY, [rng.choice(_TEXTS) for _ in range(rng.choice((0, 1, 3, 1000)))]),
            (kind.DOUBLE_ARRAY, [rng.choice(_FLOATS) for _ in range(rng.choice((0, 6, 7, 1000)))]),
            (kind.INTEGER_ARRAY, [1, 2]),
            (kind.BYTE_ARRAY, [b"a"]),
            (kind.NOT_SET, None),
        )
        fitting = [
            entry for entry in values if name in self._parameters and entry[0].value == self._parameters[name].type
        ]
        type_, value = rng.choice(fitting if fitting and rng.random() < 0.7 else values)
        # Other networks take seconds to load, which tells nothing more.
        if name in ("network", "model_file") and type_ is kind.STRING:
            value = rng.choice(("no_such", "/dev/zero", str(self._place.kept), "\x1b[2J"))
        return name, Parameter(name, type_, value)

    def _logged(self) -> tuple[str, ...]:
        """What is wrong with what the node logged since."""
        with self._log.open("rb") as file:
            file.seek(self._read)
            text = file.read().decode("utf-8", errors="backslashreplace")
            self._read = file.tell()
        # ROS colours its log, and rcl itself logs labels of unknown transitions as they came.
        text = re.sub(r"\x1b\[\d*m", "", text)
        return tuple(text_problems("\n".join(line for line in text.splitlines() if "[rcl_lifecycle]" not in line)))


class Clients:
    """Two clients of the node, and a peer that feeds it.

    Args:
        process: The node.
    """

    def __init__(self, process: NodeProcess) -> None:
        import rcl_interfaces.srv
        import rclpy
        from lifecycle_msgs import srv as lifecycle
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        from radcam_depth_ros.node.topics.factory import message_class

        self._process = process
        rclpy.init(args=[])
        self._nodes = [rclpy.create_node(name, start_parameter_services=False) for name in ("first", "second", "third")]
        self._executor = SingleThreadedExecutor()
        own = rcl_interfaces.srv
        self._classes = {
            **{"set_parameters": own.SetParameters, "set_parameters_atomically": own.SetParametersAtomically},
            **{"get_parameters": own.GetParameters, "get_parameter_types": own.GetParameterTypes},
            **{"describe_parameters": own.DescribeParameters, "list_parameters": own.ListParameters},
            **{"change_state": lifecycle.ChangeState, "get_state": lifecycle.GetState},
            **{"get_available_states": lifecycle.GetAvailableStates},
            **{"get_available_transitions": lifecycle.GetAvailableTransitions},
            **{"get_transition_graph": lifecycle.GetAvailableTransitions},
        }
        self._clients = []
        for node in self._nodes:
            self._executor.add_node(node)
            self._clients.append(
                {name: node.create_client(kind, f"radcam_depth/{name}") for name, kind in self._classes.items()}
            )
        qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        third = self._nodes[2]
        # Topics of the node's own names for those of the made-up messages.
        names = {CAMERA_INFO: "camera_info", RADAR: "radar/points", IMAGE: "image"}
        self._publishers = {
            topic: third.create_publisher(message_class(TYPES[topic]), name, qos) for topic, name in names.items()
        }
        self._depths: list[bytes] = []
        third.create_subscription(message_class(TYPES[IMAGE]), "depth/image_rect", self._depths.append, qos, raw=True)
        every = [client for clients in self._clients for client in clients.values()]
        self._until(lambda: all(client.service_is_ready() for client in every), _START_S)
        for clients in self._clients:
            for service in clients:
                self._meet(clients, service)

    def ask(self, asked: list[tuple[str, Callable[[Any], Any]]]) -> list[Any]:
        """Sends a request from each client at once; answers, None for those without one."""
        futures = []
        for clients, (_, make) in zip(self._clients, asked, strict=False):
            service, request = make(self)
            futures.append(clients[service].call_async(request))
        # The node answers one after another: once several that came later are answered, the others are lost.
        for _ in range(_LATER_REQUESTS):
            later = self._clients[2]["get_state"].call_async(self._classes["get_state"].Request())
            self._until(later.done, _PATIENCE_S)
            if all(future.done() for future in futures):
                break
        self._until(lambda: all(future.done() for future in futures), _AFTER_OTHERS_S)
        return [future.result() if future.done() else None for future in futures]

    def setting(self, service: str, given: list[tuple[str, Any]]) -> tuple[str, Any]:
        """A request that sets parameters."""
        return service, self._classes[service].Request(parameters=[value.to_parameter_msg() for _, value in given])

    def reading(self, service: str, names: list[str]) -> tuple[str, Any]:
        """A request that reads parameters."""
        kind = self._classes[service].Request
        return service, kind(prefixes=names[:3]) if service == "list_parameters" else kind(names=names)

    def plain(self, service: str) -> tuple[str, Any]:
        """A request without content."""
        return service, self._classes[service].Request()

    def transition(self, label: str, number: int) -> tuple[str, Any]:
        """A request to change the state."""
        request = self._classes["change_state"].Request()
        request.transition.label, request.transition.id = label, number
        return "change_state", request

    def parameters(self) -> dict[str, Any]:
        """The node's parameters that have a value and can be set, by name."""
        listed = self._call("list_parameters", self._classes["list_parameters"].Request()).result.names
        kind = self._classes["get_parameters"].Request
        # One by one: where one has no value, rclpy answers none of them.
        values = {name: self._call("get_parameters", kind(names=[name])).values for name in listed}
        asked = self._classes["describe_parameters"].Request(names=listed)
        fixed = {entry.name for entry in self._call("describe_parameters", asked).descriptors if entry.read_only}
        return {name: value[0] for name, value in values.items() if value and value[0].type and name not in fixed}

    def start_anew(self, parameters: dict[str, Any]) -> str:
        """Has the node unconfigured, with these parameters, then active; what went wrong, else nothing."""
        for label in ("deactivate", "cleanup"):
            self._call(*self.transition(label, 0))
        from rcl_interfaces.msg import Parameter

        # All at once: one by one, some do not fit those that are still to be set back.
        settings = self._classes["set_parameters_atomically"].Request()
        settings.parameters = [Parameter(name=name, value=value) for name, value in parameters.items()]
        result = self._call("set_parameters_atomically", settings).result
        if not result.successful:
            return f"parameters cannot be set back: {result.reason[:300]}"
        for label in ("configure", "activate"):
            if not self._call(*self.transition(label, 0)).success:
                return f"{label} failed; the log ends with {self._process.last_lines[-400:]}"
        return ""

    def depth(self) -> np.ndarray | None:
        """The depth of a good pair that is sent from now on; None where none comes."""
        from rclpy.serialization import deserialize_message

        from radcam_depth_ros.node.topics.factory import build_message, message_class

        sent: list[int] = []
        self._depths.clear()
        next_s = 0.0

        def has_come() -> bool:
            nonlocal next_s
            if time.monotonic() >= next_s:
                next_s = time.monotonic() + 0.5
                sent.append(time.time_ns())
                for topic, publisher in self._publishers.items():
                    publisher.publish(_ros(good(topic, sent[-1]), TYPES[topic], build_message))
            return any(_stamp_ns(raw) in sent for raw in self._depths)

        if not self._until(has_come, _PATIENCE_S):
            return None
        raw = next(raw for raw in self._depths if _stamp_ns(raw) in sent)
        message: Any = deserialize_message(raw, message_class(TYPES[IMAGE]))
        depth: np.ndarray = np.frombuffer(bytes(message.data), np.float32)
        return depth

    def close(self) -> None:
        """Ends the clients."""
        import rclpy

        for node in self._nodes:
            self._executor.remove_node(node)
            node.destroy_node()
        rclpy.try_shutdown()

    def _meet(self, clients: dict[str, Any], service: str) -> None:
        """Asks until the first answer: one side of DDS may know the other before it is known itself."""
        request = self._classes[service].Request()
        if service == "change_state":
            request.transition.label = "no_such"
        end_s = time.monotonic() + _START_S
        while not self._until(clients[service].call_async(request).done, _AFTER_OTHERS_S):
            if time.monotonic() > end_s:
                raise RuntimeError(f"no first answer to {service}")

    def _call(self, service: str, request: Any) -> Any:
        future = self._clients[2][service].call_async(request)
        if not self._until(future.done, _PATIENCE_S):
            raise RuntimeError(f"no answer to {service}")
        return future.result()

    def _until(self, condition: Callable[[], Any], patience_s: float) -> bool:
        """Spins until a condition holds; whether it came to hold."""
        end_s = time.monotonic() + patience_s
        while not condition():
            if time.monotonic() > end_s:
                return False
            self._process.check()
            self._executor.spin_once(timeout_sec=0.05)
        return True


def _stamp_ns(raw: bytes) -> int:
    """The stamp of a serialised message with a header."""
    seconds, nanoseconds = struct.unpack_from("<iI", raw, 4)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


def _ros(message: Any, type_name: str, build: Any) -> Any:
    """A made-up message as one of ROS's classes."""
    from rclpy.serialization import deserialize_message

    from radcam_depth_ros.bags.definitions import MessageType
    from radcam_depth_ros.node.topics.factory import message_class

    raw = bytes(MessageType.jazzy(type_name).serialise(message, ""))
    return deserialize_message(raw, message_class(type_name))
