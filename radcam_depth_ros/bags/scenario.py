"""Reads what the recorder notes about a drive: weather, time of day, season, street."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from radcam_depth_ros.bags.errors import BagError
from radcam_depth_ros.bags.reader import BagReader

SCENARIO_TOPIC = "/scenario"
"""One std_msgs/String at the bag's start: a JSON object. Simulated drives have it, and any recording may."""
_TYPE = "std_msgs/msg/String"


def read_scenario(bag: BagReader) -> Mapping[str, str]:
    """The scenario's entries that are words, by name; none for a bag without the topic.

    Raises:
        BagError: when the topic's first message is no JSON object.
    """
    return {name: value for name, value in _entries(bag).items() if isinstance(value, str) and value}


def read_key_frames(bag: BagReader) -> tuple[Mapping[str, int], ...]:
    """The key frames of an imported scene: of each the stamps in nanoseconds by topic; none of another bag.

    Raises:
        BagError: when the scenario or its key frames are none.
    """
    frames = _entries(bag).get("key_frames", [])
    stamps = [stamp for frame in frames for stamp in frame.values()] if _are_objects(frames) else [None]
    if not all(isinstance(stamp, int) for stamp in stamps):
        raise BagError(
            f"key_frames in {SCENARIO_TOPIC} of {bag.path} must be objects of stamps by topic; import the scene anew"
        )
    return tuple(frames)


def _are_objects(values: Any) -> bool:
    return isinstance(values, list) and all(isinstance(value, dict) for value in values)


def _entries(bag: BagReader) -> dict[str, Any]:
    if not any(info.name == SCENARIO_TOPIC and info.type_name == _TYPE and info.count for info in bag.topics):
        return {}
    text = str(next(bag.messages([SCENARIO_TOPIC])).message.data)
    try:
        values = json.loads(text)
    except ValueError:
        values = None
    if not isinstance(values, dict):
        raise BagError(
            f'{SCENARIO_TOPIC} of {bag.path} must be a JSON object like {{"weather": "rain"}}, got {text[:60]!r}'
        )
    return {str(name): value for name, value in values.items()}
