"""The policy of SROS 2 names exactly the topics and services of the live node."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from radcam_depth_ros.frame_builder import TRANSFORM_TOPICS
from radcam_depth_ros.node.topics.inputs import has_transform_messages
from radcam_depth_ros.parameters import NODE_NAME

POLICY = Path(__file__).parents[2] / "config" / "sros2_policy.xml"
KINDS = {"publisher": ("topics", "publish"), "subscriber": ("topics", "subscribe"), "service": ("services", "reply")}


def allowed(kind: str, what: str) -> set[str]:
    """Full names that the policy allows."""
    profile = ElementTree.parse(POLICY).getroot().find("enclaves/enclave/profiles/profile")
    assert profile is not None
    assert (profile.get("ns"), profile.get("node")) == ("/", NODE_NAME)
    lists = [entry for entry in profile.findall(kind) if entry.get(what) == "ALLOW"]
    names = [str(name.text) for entry in lists for name in entry]
    return {f"/{name.lstrip('/')}" for name in names}


def present(bench: Any, kind: str) -> set[str]:
    """Full names of what the graph says that the node has."""
    found = getattr(bench.peer, f"get_{kind}_names_and_types_by_node")(NODE_NAME, "/")
    return {name for name, _ in found}


@pytest.mark.parametrize(("transport", "other"), [("raw", "/image/compressed"), ("compressed", "/image")])
def test_the_policy_has_what_the_live_node_has_and_nothing_else(
    start_apart: Callable[..., Any], make_estimator: Callable[..., Any], transport: str, other: str
) -> None:
    # The graph is asked for the node by its name: another one of that name would answer in its place.
    bench = start_apart(
        lambda config: make_estimator(config, tells_classes=True), image_transport=transport, use_sim_time=True
    )
    bench.until(lambda: bench.state == "active", what="the node")
    absent = {other, *(() if has_transform_messages() else TRANSFORM_TOPICS)}
    for kind, allowance in KINDS.items():
        expected = allowed(*allowance) - absent
        bench.until(lambda kind=kind, expected=expected: present(bench, kind) >= expected, what=kind)
        assert present(bench, kind) == expected, kind
    assert not present(bench, "client")


def test_nothing_is_allowed_besides() -> None:
    text = POLICY.read_text(encoding="utf-8")
    assert "*" not in text
    assert text.count("ALLOW") == len(KINDS)
