"""Plots of an evaluation: error over distance, sparsification, and the reliability diagram."""

from __future__ import annotations

from radcam_depth_ros.evaluation.measures.reliability import TOLERANCE, Reliability
from radcam_depth_ros.evaluation.measures.sparsification import REMOVED, SparsificationCurve
from radcam_depth_ros.evaluation.summary import Evaluation
from radcam_depth_ros.evaluation.tables import BASELINE_TITLES, DENSE
from radcam_depth_ros.reporting.plot import Curve, Plot


def plots_of(evaluation: Evaluation) -> tuple[Plot, ...]:
    """Error over distance, sparsification by the confidence, and the confidence's reliability diagram."""
    dense = evaluation.dense.distances
    distances = (
        Curve(DENSE, dense.middles_m, dense.mae_m),
        *(
            Curve(BASELINE_TITLES[name], depth.distances.middles_m, depth.distances.mae_m, is_dashed=True)
            for name, depth in evaluation.baselines.items()
        ),
    )
    plots = [Plot("Error over distance", "distance of the ground truth, m", "MAE, m", distances)]
    sparsification = evaluation.sparsification
    if sparsification.frames:
        plots += [
            _sparsification_plot("MAE", sparsification.mae, sparsification.within_m),
            _sparsification_plot("RMSE", sparsification.rmse, sparsification.within_m),
        ]
    if evaluation.reliability.overall.pixels:
        plots.append(_reliability_plot(evaluation.reliability))
    return tuple(plots)


def _reliability_plot(reliability: Reliability) -> Plot:
    calibration = reliability.overall
    known = [entry for entry in calibration.bins if entry.pixels]
    note = (
        f"Share of the pixels whose dense depth is within {100 * TOLERANCE:g} % of the truth, over their confidence "
        f"(within {reliability.within_m:g} m). The mean distance from the diagonal, weighted by the pixels (ECE), is "
        f"{calibration.ece:.3f}."
    )
    curves = (
        Curve("observed", [entry.predicted for entry in known], [entry.observed for entry in known]),
        Curve("calibrated", (0, 1), (0, 1), is_dashed=True),
    )
    middles = [(entry.lower + entry.upper) / 2 for entry in calibration.bins]
    shares = Curve("share of the pixels", middles, [entry.share for entry in calibration.bins])
    return Plot("Reliability of the confidence", "confidence", "share", curves, note, shares)


def _sparsification_plot(measure: str, curve: SparsificationCurve, within_m: float) -> Plot:
    removed = [100 * share for share in REMOVED]
    note = (
        f"Error of what is left when the least confident pixels are left out (within {within_m:g} m). The oracle "
        f"leaves out the largest errors first; the area between the two (AUSE) is {curve.ause_m:.3f} m."
    )
    curves = (
        Curve("by confidence", removed, curve.by_confidence),
        Curve("oracle", removed, curve.oracle, is_dashed=True),
    )
    return Plot(f"Sparsification, {measure}", "pixels left out, %", f"{measure}, m", curves, note)
