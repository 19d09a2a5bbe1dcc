"""Compares the depth of two ways to run the same weights."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from radcam_depth_ros.benchmarking.figures import DriveFigures
from radcam_depth_ros.benchmarking.subject import BenchmarkError, NetworkInputs
from radcam_depth_ros.drive import Sample
from radcam_depth_ros.engine import Engine
from radcam_depth_ros.estimator import Estimator
from radcam_depth_ros.evaluation.measures.metrics import DepthAccumulator


def depth_difference(engine: Engine, other: Engine, inputs: NetworkInputs) -> float:
    """Median over the image of |dense - other's| / other's."""
    dense, reference = (side.run(*inputs.as_tuple()).dense for side in (engine, other))
    return float(((dense - reference).abs() / reference).median())


def difference_over_drive(samples: Iterable[Sample], estimator: Estimator, other: Estimator) -> DriveFigures:
    """Estimates every frame with both.

    Raises:
        BenchmarkError: when there are no frames.
    """
    errors, other_errors = DepthAccumulator(), DepthAccumulator()
    medians: list[float] = []
    for sample in samples:
        dense, reference = estimator.estimate(sample.frame).dense, other.estimate(sample.frame).dense
        medians.append(float(np.median(np.abs(dense - reference) / reference)))
        errors.add(dense, sample.depth_m)
        other_errors.add(reference, sample.depth_m)
    if not medians:
        raise BenchmarkError("expected a bag with at least one image that goes with its radar sweeps, got none")
    return DriveFigures(len(medians), float(np.median(medians)), errors.result()[-1].mae, other_errors.result()[-1].mae)
