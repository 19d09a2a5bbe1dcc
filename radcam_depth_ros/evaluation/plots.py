"""The curves of an evaluation: error over distance, and sparsification."""

from __future__ import annotations

from radcam_depth_ros.evaluation.sparsification import REMOVED, SparsificationCurve
from radcam_depth_ros.evaluation.summary import Evaluation
from radcam_depth_ros.evaluation.tables import BASELINE_TITLES, DENSE
from radcam_depth_ros.reporting.plot import Curve, Plot


def plots_of(evaluation: Evaluation) -> tuple[Plot, ...]:
    """Error over distance, and over the share of the pixels that the confidence leaves out."""
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
    return tuple(plots)


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
