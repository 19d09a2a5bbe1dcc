"""Lane markings: lines, dashes, stop lines, crossings, arrows."""

from __future__ import annotations

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.settings.configuration import StreetKind
from radcam_depth_ros.simulation.world.street import STRETCH_M, Stretch

_HEIGHT_M = 0.007


def paint_markings(stretch: Stretch, wear: float) -> None:
    """Paints a stretch; `wear` is the albedo that is left of the paint."""
    style = stretch.style
    white = Material(Surface.PAINT_MARK, Label.ROAD, (wear, wear, wear * 0.97), Texture.MARK, 2.5)
    centre = Material(Surface.PAINT_MARK, Label.ROAD, (wear, wear * 0.72, wear * 0.2), Texture.MARK, 2.5)
    centre = centre if style.yellow_lines else white
    narrow = style.lane_m < (2.8 if style.kind is StreetKind.RESIDENTIAL else 2.5)
    if narrow or style.kind is StreetKind.CAR_PARK or style.road in (Texture.GRAVEL, Texture.COBBLES, Texture.PAVING):
        return
    width = 0.15 if style.kind is StreetKind.HIGHWAY else 0.12
    dash, gap = (6.0, 12.0) if style.kind is StreetKind.HIGHWAY else (3.0, 6.0)
    half = style.median_m / 2
    _centre_line(stretch, centre, width, dash, gap)
    for lanes, sign in ((style.lanes, -1), (style.oncoming_lanes, 1)):
        for lane in range(1, lanes):
            _dashes(stretch, sign * (half + lane * style.lane_m), white, width, dash, gap)
        if style.shoulder_m > 0.25:
            _line(stretch, sign * (half + lanes * style.lane_m), white, width)
    if np.isfinite(stretch.crossing_m):
        _crossing(stretch, white)
    elif stretch.rng.random() < 0.12:
        lane = int(stretch.rng.integers(style.lanes))
        _arrow(stretch, style.lane_centre_m(lane), stretch.start_m + stretch.rng.uniform(5, 35), white)


def _centre_line(stretch: Stretch, material: Material, width: float, dash: float, gap: float) -> None:
    style = stretch.style
    half = style.median_m / 2
    if half > 0:
        for sign in (-1, 1):
            _line(stretch, sign * (half - 0.15), material, width)
    elif style.lanes > 1 or (style.kind is StreetKind.RURAL and stretch.rng.random() < 0.3):
        for sign in (-1, 1):
            _line(stretch, sign * 0.12, material, width)
    else:
        _dashes(stretch, 0.0, material, width, dash, gap)


def _line(stretch: Stretch, t: float, material: Material, width: float) -> None:
    stretch.strip(t - width / 2, t + width / 2, _HEIGHT_M, material)


def _dashes(stretch: Stretch, t: float, material: Material, width: float, dash: float, gap: float) -> None:
    period = dash + gap
    first = np.floor(stretch.start_m / period) * period
    for start in np.arange(first, stretch.stop_m, period):
        low, high = max(start, stretch.start_m), min(start + dash, stretch.stop_m)
        if high > low + 0.05:
            stretch.strip(t - width / 2, t + width / 2, _HEIGHT_M, material, float(low), float(high))


def _crossing(stretch: Stretch, material: Material) -> None:
    """A zebra before the side road and a stop line before that."""
    style, at = stretch.style, stretch.crossing_m - stretch.style.crossing_half_m - 3.4
    if at - 4 < stretch.start_m or at > stretch.start_m + STRETCH_M:
        return
    if style.kind in (StreetKind.TOWN, StreetKind.ARTERIAL):
        for t in np.arange(-style.right_edge_m + 0.3, style.left_edge_m - 0.5, 1.0):
            stretch.strip(float(t), float(t) + 0.5, _HEIGHT_M + 0.002, material, at, at + 3.0)
        stretch.strip(-style.right_edge_m, -style.median_m / 2, _HEIGHT_M + 0.002, material, at - 1.8, at - 1.4)


def _arrow(stretch: Stretch, t: float, s: float, material: Material) -> None:
    stretch.strip(t - 0.08, t + 0.08, _HEIGHT_M, material, s, s + 2.6)
    for step in range(6):
        half = 0.42 * (1 - step / 6)
        stretch.strip(t - half, t + half, _HEIGHT_M, material, s + 2.6 + step * 0.25, s + 2.85 + step * 0.25)
