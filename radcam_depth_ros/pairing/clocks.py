"""Detects from stamps that the clocks of two sensors differ."""

from __future__ import annotations

CLOCK_WARNING_S = 0.2
"""Two sensors' stamps, measured by when they arrive, seldom differ by so much when their clocks are right."""
CLOCK_CERTAIN_S = 1.0
"""No driver takes that long: the clocks differ."""
MAX_TIME_OFFSET_S = 10.0
"""`radar_time_offset_s` corrects no more."""


def unset_stamps(topic: str, *, is_radar: bool) -> str:
    """What is wrong with a sensor whose stamps are 0, and what to do."""
    remedy = "set them in the driver" + (", or set radar_stamps: arrival" if is_radar else "")
    return f"expected stamps on {topic}, got a stamp of 0 on each message, so all but the first are dropped; {remedy}"


def clock_warning(topic: str, offset_s: float, measured_by: str, radar_time_offset_s: float = 0.0) -> str:
    """What is wrong with a radar's stamps, and what to do.

    Args:
        topic: The radar's.
        offset_s: How far its stamps, `radar_time_offset_s` added, are ahead of the images', seconds.
        measured_by: How that is known.
        radar_time_offset_s: What is set now, seconds.
    """
    where = "ahead of" if offset_s > 0 else "behind"
    set_s = radar_time_offset_s - offset_s
    remedy = f"set radar_time_offset_s: {set_s:.3f}" if abs(set_s) <= MAX_TIME_OFFSET_S else "set radar_stamps: arrival"
    doubt = "" if abs(offset_s) > CLOCK_CERTAIN_S else ", unless one of the two drivers takes that long"
    return (
        f"{measured_by} the stamps on {topic} are {abs(offset_s) * 1e3:.0f} ms {where} the images'{doubt}; synchronise "
        f"the clocks, or {remedy}"
    )
