"""CUDA graphs as far as they can be tried without a GPU."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn

from radcam_depth_ros.engine.calls import PlainCalls, blank_frame, forward
from radcam_depth_ros.engine.graphs import WARM_UP_RETURNS, Captured, CudaGraphs, Inputs, padded_count
from radcam_depth_ros.networks import Depths

CPU = torch.device("cpu")


class Counts(nn.Module):
    """Depth is the number of returns, and what is in the image's first pixel."""

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        assert torch.isfinite(radar[~valid]).all()
        dense = torch.ones_like(image[:, :1]) * valid.sum() + image[:, :1, :1, :1]
        return Depths(dense, dense, dense)


@pytest.mark.parametrize(
    ("returns", "padded"), [(0, 64), (1, 64), (64, 64), (65, 128), (129, 256), (512, 512), (1000, 1024), (3000, 4096)]
)
def test_numbers_of_returns_share_graphs(returns: int, padded: int) -> None:
    assert padded_count(returns) == padded


def test_a_frame_takes_the_place_of_the_last_one() -> None:
    inputs = Inputs(32, 64, 64, CPU)
    for returns, ground in ((40, float("nan")), (3, 0.5), (0, 0.25)):
        image, radar = torch.full((32, 64, 3), returns, dtype=torch.uint8), torch.full((returns, 6), float("nan"))
        inputs.fill(image, radar, torch.full((4,), ground))
        inputs.upload()
        got_image, got_radar, valid, got_ground = inputs.device
        torch.testing.assert_close(got_image, image)
        torch.testing.assert_close(got_radar[:returns], radar, equal_nan=True)
        assert (got_radar[returns:] == 1.0).all()
        assert valid.tolist() == [True] * returns + [False] * (64 - returns)
        torch.testing.assert_close(got_ground, torch.full((4,), ground), equal_nan=True)
        depths = forward(Counts(), *inputs.device, torch.bfloat16)
        assert float(depths.dense[0, 0, 0, 0]) == pytest.approx(returns * (1 + 1 / 255), rel=0.01)


def test_without_graphs_the_network_is_called_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    graphs = CudaGraphs(Counts(), CPU, torch.float32)
    attempts: list[tuple[int, int, int]] = []

    def fail(*key: int) -> Captured:
        attempts.append(key)
        raise RuntimeError("operation not permitted when stream is capturing\nand more lines")

    monkeypatch.setattr(graphs, "_capture", fail)
    assert graphs.describe() == "CUDA graphs"
    given = blank_frame(32, 64, 5)
    for _ in range(2):
        for got, expected in zip(graphs.run(*given), PlainCalls(Counts(), CPU, torch.float32).run(*given), strict=True):
            torch.testing.assert_close(got, expected)
    assert attempts == [(32, 64, 64)], "a capture that failed is not tried again"
    assert graphs.describe() == (
        "plain calls, since no CUDA graph could be captured: operation not permitted when stream is capturing"
    )


def test_graphs_are_kept_by_size_and_captured_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    graphs = CudaGraphs(Counts(), CPU, torch.float32)
    captured: list[tuple[int, int, int]] = []
    monkeypatch.setattr(graphs, "_capture", lambda *key: captured.append(key) or key)
    monkeypatch.setattr(graphs, "_replay", lambda graph, *given: graph)
    graphs.warm_up(32, 64)
    assert captured == [(32, 64, count) for count in WARM_UP_RETURNS]
    assert graphs.run(*blank_frame(32, 64, 100)) == (32, 64, 128)
    assert len(captured) == len(WARM_UP_RETURNS)
    assert graphs.run(*blank_frame(64, 64, 1)) == (64, 64, 64)
    assert len(captured) == len(WARM_UP_RETURNS) + 1


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_on_a_gpu_graphs_give_what_plain_calls_give() -> None:
    device = torch.device("cuda")
    graphs, plain = CudaGraphs(Counts(), device, torch.bfloat16), PlainCalls(Counts(), device, torch.bfloat16)
    for returns in (5, 0, 70, 5):
        given = blank_frame(32, 64, returns)
        for got, expected in zip(graphs.run(*given), plain.run(*given), strict=True):
            torch.testing.assert_close(got, expected)
    assert graphs.failure == ""
