"""Compares the clocks of a bag's sensors, and explains why images found no sweep or scan."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.pairing import unset_stamps

_SAMPLES = 200
_ENOUGH = 5
MAX_OFFSET_S = 1.0
"""Two sensors' stamps, measured against the recorder's clock, differ by less: what is above is no latency."""


class Clocks:
    """The stamps of a bag's sensors, beside the time at which they were recorded.

    Args:
        image: The images' topic, which all others are compared with.
        radars: The radars' topics.
    """

    def __init__(self, image: str, radars: Collection[str] = ()) -> None:
        self._image, self._radars = image, radars
        self._stamps_ns: dict[str, list[int]] = {image: []}
        self._delays_ns: dict[str, list[int]] = {image: []}

    def add(self, topic: str, stamp_ns: int, log_time_ns: int) -> None:
        """Takes a message's times."""
        self._stamps_ns.setdefault(topic, []).append(stamp_ns)
        delays = self._delays_ns.setdefault(topic, [])
        if len(delays) < _SAMPLES:
            delays.append(log_time_ns - stamp_ns)

    def offset_s(self, topic: str) -> float | None:
        """How far a topic's stamps are ahead of the images', by the recorder's clock; None where nobody can tell."""
        delays, images = self._delays_ns.get(topic, []), self._delays_ns[self._image]
        if min(len(delays), len(images)) < _ENOUGH:
            return None
        offset = float(np.median(images) - np.median(delays))
        # A bag that was written in one go, at other times than its messages were taken, tells nothing.
        spread = max(float(np.subtract(*np.percentile(values, (90, 10)))) for values in (delays, images))
        return offset / 1e9 if spread < abs(offset) / 4 else None

    def wrong(self, topics: Collection[str]) -> str | None:
        """Says which of some topics has stamps that are off by seconds; None where none has."""
        for topic in topics:
            offset_s = self.offset_s(topic)
            if offset_s is not None and abs(offset_s) > MAX_OFFSET_S:
                return self._apart(topic, offset_s)
        return None

    def reason(self, topic: str, max_offset_s: float) -> str:
        """Says why the messages of a topic are mostly farther from the images than `max_offset_s`."""
        stamps, images = (np.sort(self._stamps_ns.get(name, [])) for name in (topic, self._image))
        if not len(stamps) or not len(images):
            return f"no message came on {topic}"
        if stamps[0] > images[-1] or stamps[-1] < images[0]:
            return self._apart(topic, float(stamps[0] - images[0]) / 1e9)
        if len(stamps) < len(images) / 10:
            return f"{topic} has {len(stamps)} for {len(images)} images; record it all the time"
        typical_s = float(np.median(_distances(images, stamps))) / 1e9
        return (
            f"the nearest on {topic} is typically {typical_s:.3f} s away, more than the {max_offset_s:g} s that are "
            "allowed; check the sensors' clocks, or allow more"
        )

    def _apart(self, topic: str, offset_s: float) -> str:
        if not any(self._stamps_ns[topic]):
            return unset_stamps(topic, is_radar=topic in self._radars)
        where = "ahead of" if offset_s > 0 else "behind"
        return (
            f"the stamps on {topic} are {abs(offset_s):.2f} s {where} those on {self._image}; synchronise the sensors' "
            "clocks, or correct the stamps in the bag"
        )


def _distances(images: npt.NDArray[np.int64], stamps: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """From each image to the nearest of the stamps; both ascend."""
    after = np.searchsorted(stamps, images).clip(0, len(stamps) - 1)
    before = (after - 1).clip(0)
    nearest: npt.NDArray[np.int64] = np.minimum(np.abs(stamps[after] - images), np.abs(stamps[before] - images))
    return nearest
