from __future__ import annotations

import copy

import torch
from torch import nn

from radcam_depth_ros.training.distributed.normalisation import (
    JointBatchNorm,
    freeze_statistics,
    join_batch_norms,
    share_statistics,
)
from radcam_depth_ros.training.distributed.ranks import Ranks


def test_a_joint_batch_norm_of_one_process_is_torchs() -> None:
    torch.manual_seed(0)
    norm = nn.BatchNorm2d(3, momentum=0.2).double()
    nn.init.uniform_(norm.weight)
    nn.init.uniform_(norm.bias)
    joint = JointBatchNorm(norm, Ranks()).double()
    for training in (True, True, False):
        results, inputs = [], []
        for module in (norm.train(training), joint.train(training)):
            x = torch.linspace(-1, 5, 120, dtype=torch.float64).reshape(2, 3, 4, 5).requires_grad_()
            module.zero_grad()
            result = module(x)
            result.pow(3).sum().backward()
            results.append(result.detach())
            inputs.append(x.grad)
        torch.testing.assert_close(results[0], results[1])
        torch.testing.assert_close(inputs[0], inputs[1])
        torch.testing.assert_close(norm.weight.grad, joint.weight.grad)
        torch.testing.assert_close(dict(norm.named_buffers()), dict(joint.named_buffers()))


def test_batch_norms_are_joined_with_what_they_hold() -> None:
    network = nn.Sequential(nn.Conv2d(1, 2, 1), nn.Sequential(nn.BatchNorm2d(2)))
    state = copy.deepcopy(network.state_dict())
    join_batch_norms(network, Ranks(0, 2))
    assert sum(isinstance(module, JointBatchNorm) for module in network.modules()) == 1
    assert all(torch.equal(value, network.state_dict()[name]) for name, value in state.items())


def test_frozen_statistics_stay_while_weights_learn() -> None:
    network = nn.Sequential(nn.BatchNorm2d(2)).train()
    freeze_statistics(network)
    network(torch.rand(2, 2, 4, 4)).sum().backward()
    assert torch.equal(network[0].running_mean, torch.zeros(2))
    assert network[0].weight.grad is not None
    assert network.training


class Doubled(Ranks):
    """As if a second process had three times the values."""

    def add(self, values: torch.Tensor) -> torch.Tensor:
        return values + 3 * values


def test_running_statistics_become_the_mean_of_all_processes() -> None:
    network = nn.Sequential(nn.BatchNorm2d(2), nn.Conv2d(2, 1, 1))
    network[0].running_mean.copy_(torch.tensor([1.0, 2.0]))
    share_statistics(network, Doubled(0, 2))
    assert network[0].running_mean.tolist() == [2.0, 4.0]
    assert network[0].running_var.tolist() == [2.0, 2.0]
    share_statistics(network, Ranks())
    assert network[0].running_mean.tolist() == [2.0, 4.0]
