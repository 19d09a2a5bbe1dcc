from __future__ import annotations

import dataclasses
import pickle

import pytest

from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.fleet.errors import FleetError
from radcam_depth_ros.fleet.work.weights import Weights


def test_weights_of_a_file_travel_with_it(estimator):
    sent = pickle.loads(pickle.dumps(Weights.of(estimator)))
    assert sent.loaded is None
    assert sent.load().computation == estimator.computation
    other = dataclasses.replace(sent, computation=dataclasses.replace(sent.computation, weights_sha256="0"))
    with pytest.raises(FleetError, match="install the same version"):
        other.load()


def test_weights_of_the_package_are_there_already():
    estimator = Estimator(EstimatorConfig(precision="float32", threads=1))
    sent = pickle.loads(pickle.dumps(Weights.of(estimator)))
    assert sent.files == ()
    assert sent.load().computation == estimator.computation
