"""A run that is killed at any moment: `python counting_run.py DRIVES OUT LOG SECONDS [local|ray]`."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from fleet.numbering import Numbering

from radcam_depth_ros.fleet.engines import engine_of
from radcam_depth_ros.fleet.running import run
from radcam_depth_ros.fleet.unit import units_of

if __name__ == "__main__":
    drives, out, log, seconds, *on = sys.argv[1:]
    places = [str(path) for path in sorted(Path(drives).iterdir())]
    run(Numbering(log, seconds=float(seconds)), units_of(places), out, None, engine_of(*on or [None]))
