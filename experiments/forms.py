"""Holds the forms of the networks that `experiments.ablation` compares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

NONE, ALL = "none", "all"
EMBEDDING, REGIONS = "embedding, few returns", "regions, few returns"
SEG, SINGLE = "seg", "single"
ALONE = "alone"


@dataclass(frozen=True)
class Form:
    """A row of an ablation.

    Attributes:
        network: Its name in the registry.
        against: The form that it is held against.
        architecture: Values of the network's config that differ from its defaults.
        recipe: Values of the recipe that differ from what all forms have.
        has_few_returns: Whether it is trained and measured with few returns: regions cost as much as there are.
        is_taught: Whether it learns from a teacher besides.
        is_random: Whether it starts from random weights though others start from those of a backbone.
    """

    network: str
    against: str
    architecture: Mapping[str, Any] = field(default_factory=dict)
    recipe: Mapping[str, Any] = field(default_factory=dict)
    has_few_returns: bool = False
    is_taught: bool = False
    is_random: bool = False


def _parts(*, bf: bool = False, ca: bool = False, pa: bool = False) -> Form:
    return Form("baff", NONE, {"bidirectional": bf, "channel_attention": ca, "position_attention": pa})


def _fusion(fusion: str) -> Form:
    return Form("structured", SINGLE, {"fusion": fusion})


def _omega(road: float) -> Form:
    """`seg` itself has 1.4."""
    return Form("structured", SEG, {"fusion": "seg"}, {"loss": {"road": road}})


def _taught(*terms: str) -> Form:
    """By these terms of the distillation, or by all of them."""
    weights = {name: 0.0 for name in ("image", "radar", "decoder", "inter_depth") if terms and name not in terms}
    return Form("lircdepth", ALONE, recipe={"distillation": weights}, is_taught=True)


FORMS = {
    NONE: _parts(),
    "BF": _parts(bf=True),
    "CA": _parts(ca=True),
    "PA": _parts(pa=True),
    "BF+CA": _parts(bf=True, ca=True),
    "BF+PA": _parts(bf=True, pa=True),
    ALL: _parts(bf=True, ca=True, pa=True),
    "all, random features": Form("baff", ALL, is_random=True),
    "all, one encoder": Form("baff", ALL, {"context": "none"}, is_random=True),
    "all, enlarged linearly": Form("baff", ALL, {"full_size": False}),
    EMBEDDING: Form("baff", EMBEDDING, {"association": "embedding"}, has_few_returns=True),
    REGIONS: Form("baff", EMBEDDING, {"association": "regions"}, has_few_returns=True),
    SINGLE: _fusion("single"),
    "add": _fusion("add"),
    "conf": _fusion("conf"),
    SEG: _fusion("seg"),
    "omega 0.6": _omega(0.6),
    "omega 1.0": _omega(1.0),
    "omega 1.8": _omega(1.8),
    ALONE: Form("lircdepth", ALONE),
    "taught": _taught(),
    "taught: image": _taught("image"),
    "taught: radar": _taught("radar"),
    "taught: decoder": _taught("decoder"),
    "taught: inter-depth": _taught("inter_depth"),
}


def forms_of(network: str) -> tuple[str, ...]:
    """Names of a network's forms."""
    return tuple(name for name, form in FORMS.items() if form.network == network)
