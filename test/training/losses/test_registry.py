from __future__ import annotations

from dataclasses import replace

import pytest

from radcam_depth_ros import networks
from radcam_depth_ros.configuration import ConfigurationError
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.baff import LossConfig
from radcam_depth_ros.training.losses.registry import Criterion

LOSS: LossConfig = Criterion.of("baff", {}).config


@pytest.mark.parametrize("network", networks.names())
def test_every_network_can_be_trained(network: str) -> None:
    assert Criterion.of(network, {}).config is not None


def test_values_replace_the_defaults() -> None:
    assert Criterion.of("baff", {"sky": 0.5}).config == replace(LOSS, sky=0.5)


def test_what_a_network_has_no_loss_for_is_refused() -> None:
    with pytest.raises(TrainingError, match=r"baffle cannot be trained: it has no losses; those that have: .*baff"):
        Criterion.of("baffle", {})
    with pytest.raises(ConfigurationError, match=r"the losses of baff: .*skye.*did you mean sky\?"):
        Criterion.of("baff", {"skye": 0.5})
    with pytest.raises(TrainingError, match="must not be negative"):
        Criterion.of("baff", {"sky": -0.5})
