"""Pairs and waits of images in typical and bad conditions, without ROS.

    python -m benchmarks.pairing

Each scenario is a camera and a radar with their stamps and arrivals, drawn by a seed. `nearest` are the images that
got the nearest of all sweeps. Waits are from an image's arrival to its pair, in milliseconds.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.pairing import Pair, Pairer, PairingConfig

_MS = 1_000_000
_SECOND = 1000 * _MS
_TICK_NS = 20 * _MS
_RADAR = "radar"
_COLUMNS = ("images", "paired", "nearest", "wait_mean_ms", "wait_p99_ms", "offset_mean_ms")


@dataclass(frozen=True)
class Scenario:
    """A camera and a radar.

    Attributes:
        camera_hz: Images a second.
        radar_hz: Sweeps a second.
        seconds: How long a loop is.
        jitter_s: Standard deviation of the sweeps' stamps.
        lost: Share of the messages of each that do not come.
        loops: How often the same stamps come.
        delay_s: From a stamp to its arrival, at least and at most.
    """

    camera_hz: float
    radar_hz: float
    seconds: float = 60.0
    jitter_s: float = 0.0
    lost: float = 0.0
    loops: int = 1
    delay_s: tuple[float, float] = (0.002, 0.004)


SCENARIOS = {
    "camera 10 Hz, radar 13 Hz": Scenario(10, 13),
    "camera 30 Hz, radar 20 Hz": Scenario(30, 20),
    "camera 30 Hz, radar 20 Hz, 10 % lost": Scenario(30, 20, lost=0.1),
    "camera 10 Hz, radar 13 Hz, six loops": Scenario(10, 13, seconds=5.0, loops=6),
    "camera 10 Hz, radar 20 Hz, jitter 10 ms": Scenario(10, 20, jitter_s=0.01),
    "camera 10 Hz, radar 20 Hz, out of order": Scenario(10, 20, delay_s=(0.0, 0.08)),
}


def _arrivals(scenario: Scenario, hz: float, jitter_s: float, rng: np.random.Generator) -> list[tuple[int, int]]:
    """Arrival and stamp of each message, nanoseconds."""
    count = round(scenario.seconds * hz)
    stamps_s = (np.arange(count) + rng.uniform()) / hz + rng.normal(0.0, jitter_s, count)
    stamps_s = np.sort(stamps_s)[rng.uniform(size=count) >= scenario.lost]
    found = []
    for loop in range(scenario.loops):
        delays_s = rng.uniform(*scenario.delay_s, len(stamps_s)) + loop * scenario.seconds
        arrivals_ns = np.rint((stamps_s + delays_s) * _SECOND).astype(np.int64)
        found += list(zip(arrivals_ns.tolist(), np.rint(stamps_s * _SECOND).astype(np.int64).tolist(), strict=True))
    return found


def measure(scenario: Scenario, seed: int) -> dict[str, Any]:
    """Counts and waits of a scenario."""
    rng = np.random.default_rng(seed)
    images = _arrivals(scenario, scenario.camera_hz, 0.0, rng)
    sweeps = _arrivals(scenario, scenario.radar_hz, scenario.jitter_s, rng)
    last_ns = max(now for now, _ in (*images, *sweeps))
    events = [(now, 1, stamp) for now, stamp in images] + [(now, 0, stamp) for now, stamp in sweeps]
    events += [(now, 2, 0) for now in range(0, last_ns + _SECOND, _TICK_NS)]
    pairer: Pairer[int, int] = Pairer((_RADAR,), PairingConfig())
    waits_ms: list[float] = []
    pairs: list[Pair[int, int]] = []
    for now, kind, stamp in sorted(events):
        if kind == 0:
            ready = pairer.add_sweep(_RADAR, stamp, stamp, now)
        else:
            ready = pairer.add_image(stamp, now, now) if kind == 1 else pairer.expire(now)
        pairs += ready
        waits_ms += [(now - pair.image) / _MS for pair in ready]
    stamps = np.unique([stamp for _, stamp in sweeps])
    offsets_ms = [abs(offset) * 1e3 for pair in pairs if (offset := pair.offsets_s[0]) is not None]
    nearest = [
        np.abs(stamps - pair.stamp_ns).min() == abs(pair.sweeps[0] - pair.stamp_ns)
        for pair in pairs
        if pair.sweeps[0] is not None
    ]
    return {
        "images": len(images),
        "paired": len(offsets_ms),
        "nearest": int(np.sum(nearest)),
        "wait_mean_ms": round(float(np.mean(waits_ms)), 1),
        "wait_p99_ms": round(float(np.percentile(waits_ms, 99)), 1),
        "offset_mean_ms": round(float(np.mean(offsets_ms)), 1),
    }


def main() -> None:
    """Measures all scenarios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1, help="Of stamps, losses and delays.")
    parser.add_argument("--json", metavar="FILE", help="Where to write the figures; - for the terminal.")
    options = parser.parse_args()
    rows = {name: measure(scenario, options.seed) for name, scenario in SCENARIOS.items()}
    if options.json is not None:
        write_json(rows, options.json)
        return
    table = Table("scenario", *(name.replace("_", " ") for name in _COLUMNS))
    for name, row in rows.items():
        table.add_row(name, *(str(row[column]) for column in _COLUMNS))
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
