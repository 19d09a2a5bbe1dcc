from __future__ import annotations

import math
from xml.etree import ElementTree

import pytest

from radcam_depth_ros.reporting.errors import ReportError
from radcam_depth_ros.reporting.plot import Curve, Plot, draw_plot


def test_a_plot_is_a_drawing_with_its_labels():
    curves = (Curve("dense & co", (0, 1, 2), (1.0, math.nan, 3.0)), Curve("oracle", (0, 1), (1, 0), is_dashed=True))
    drawn = draw_plot(Plot("Error", "distance, m", "MAE, m", curves))
    texts = "".join(ElementTree.fromstring(drawn).itertext())
    for shown in ("dense & co", "oracle", "distance, m", "MAE, m"):
        assert shown in texts
    assert draw_plot(Plot("Error", "distance, m", "MAE, m", curves)) == drawn


def test_a_curve_of_unequal_lengths_is_refused():
    with pytest.raises(ReportError, match="as many x as y, got 2 and 1"):
        Curve("odd", (0, 1), (1,))


def test_bars_are_drawn_behind_the_curves():
    curves = (Curve("observed", (0, 1), (0, 1)),)
    bare = draw_plot(Plot("Reliability", "confidence", "share", curves))
    drawn = draw_plot(
        Plot("Reliability", "confidence", "share", curves, bars=Curve("pixels", (0.25, 0.75), (0.1, 0.9)))
    )
    assert "pixels" in "".join(ElementTree.fromstring(drawn).itertext())
    assert len(drawn) > len(bare)
