"""The sections of a network, taken out of it and made ready to be timed one by one."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode, sdpa_flop_count

from radcam_depth_ros.benchmarking.memory import peak_allocated_mb
from radcam_depth_ros.benchmarking.rotation import Task
from radcam_depth_ros.benchmarking.subject import NetworkInputs, Running, Subject
from radcam_depth_ros.engine.calls import forward
from radcam_depth_ros.networks.layers.number_formats import convert
from radcam_depth_ros.networks.weights_io import torchscript
from radcam_depth_ros.networks.weights_io.folding import folded
from radcam_depth_ros.networks.weights_io.onnx_file import OnnxNetwork

GFLOP_COUNTING = (
    "2 operations a multiply-add, of convolutions, matrix products and attention only, counted by "
    "torch.utils.flop_counter in an eager pass"
)


@dataclass(frozen=True)
class Section:
    """A submodule with what it is given; several of one name are one section together.

    Attributes:
        name: Of the section.
        gflop: Operations in billions; see `GFLOP_COUNTING`.
        peak_memory_mb: What it holds at once of what it allocates itself, MiB.
        task: Runs it once.
    """

    name: str
    gflop: float
    peak_memory_mb: float
    task: Task


@dataclass(frozen=True)
class Anatomy:
    """A network in pieces.

    Attributes:
        gflop: Operations of the whole, in billions; NaN of an ONNX file, which torch cannot count.
        sections: In order of execution.
    """

    gflop: float
    sections: tuple[Section, ...]


def dissect(running: Running, inputs: NetworkInputs, only: str = "") -> Anatomy:
    """Counts a network's operations, and takes its sections out, with their inputs, frozen as the whole is.

    Args:
        running: The network.
        inputs: Of the whole network.
        only: Name of the section to take out; empty for all.
    """
    subject, loaded = running.resolved, running.loaded
    if isinstance(loaded.network, OnnxNetwork):
        return Anatomy(math.nan, ())
    wanted = [(name, path) for name, path in loaded.sections if only in ("", name)]
    eager = _eager(loaded.network, subject)
    captured: dict[str, tuple[Any, ...]] = {}
    hooks = [eager.get_submodule(path).register_forward_pre_hook(_capture(captured, path)) for _, path in wanted]
    counter = _flop_counter()
    with counter:
        _run(eager, subject, inputs)
    for hook in hooks:
        hook.remove()
    counts = counter.get_flop_counts()
    root = type(eager).__name__
    sections: list[Section] = []
    for name, path in wanted:
        gflop = 1e-9 * sum(counts.get(f"{root}.{path}", {}).values())
        call = _runner(loaded.network.get_submodule(path), subject, captured[path])
        sections.append(Section(name, gflop, peak_allocated_mb(call, subject.device), Task(name, call)))
    return Anatomy(1e-9 * counter.get_total_flops(), tuple(sections))


def count_gflop(running: Running, inputs: NetworkInputs) -> float:
    """Operations of the whole network, in billions; see `GFLOP_COUNTING`. NaN of an ONNX file."""
    subject, counter = running.resolved, _flop_counter()
    if isinstance(running.loaded.network, OnnxNetwork):
        return math.nan
    eager = _eager(running.loaded.network, subject)
    with counter:
        _run(eager, subject, inputs)
    return 1e-9 * counter.get_total_flops()


def _eager(network: nn.Module, subject: Subject) -> nn.Module:
    """A copy with the engine's weights, before it is frozen; an export as it is."""
    if isinstance(network, torch.jit.ScriptModule):
        return network
    dtype = getattr(torch, subject.precision)
    if subject.mode == "eager":
        return convert(copy.deepcopy(network).eval(), dtype).to(subject.device)
    return folded(network, dtype, subject.device)


def _run(network: nn.Module, subject: Subject, inputs: NetworkInputs) -> None:
    """Calls a network as the engine does."""
    image, radar, ground = (value.to(subject.device) for value in inputs.as_tuple())
    valid = torch.ones(len(radar), dtype=torch.bool, device=subject.device)
    layout = torch.contiguous_format if subject.mode == "eager" else torch.channels_last
    with torch.inference_mode():
        forward(network, image, radar, valid, ground, getattr(torch, subject.precision), layout)


def _flop_counter() -> FlopCounterMode:
    # torch counts attention on a GPU only.
    def attention(query: Any, key: Any, value: Any, *_: Any, **__: Any) -> int:
        return int(sdpa_flop_count(query, key, value))  # type: ignore[no-untyped-call]  # torch leaves it without types

    mapping = {torch.ops.aten._scaled_dot_product_flash_attention_for_cpu: attention}
    return FlopCounterMode(display=False, custom_mapping=mapping)


def _capture(captured: dict[str, tuple[Any, ...]], path: str) -> Callable[[nn.Module, tuple[Any, ...]], None]:
    def hook(_: nn.Module, arguments: tuple[Any, ...]) -> None:
        # Copied, since what comes after may change a list, or a tensor in place.
        captured[path] = copy.deepcopy(arguments)

    return hook


def _runner(section: nn.Module, subject: Subject, arguments: tuple[Any, ...]) -> Callable[[], object]:
    """Runs a section as the whole network's engine would, warmed up."""
    # On a GPU the engine replays one graph of the whole: there its sections run eagerly.
    is_frozen = subject.mode == "frozen" and subject.device == "cpu"
    module = torchscript.freeze(section, getattr(torch, subject.precision)) if is_frozen else _eager(section, subject)

    def call() -> object:
        with torch.inference_mode():
            return module(*arguments)

    # TorchScript profiles the first call and optimises in the second.
    for _ in range(3):
        call()
    return call
