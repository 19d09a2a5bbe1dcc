from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from radcam_depth_ros.configuration import ConfigurationError, as_mapping, build, load
from radcam_depth_ros.frame import RadcamDepthError


@dataclass(frozen=True)
class Inner:
    near_m: float = 1.0
    sizes: tuple[int, ...] = (1, 2)


@dataclass(frozen=True)
class Outer:
    name: str = "x"
    inner: Inner = field(default_factory=Inner)
    parts: tuple[Inner, ...] = ()

    def __post_init__(self) -> None:
        if not self.name:
            raise RadcamDepthError("a name is needed")


def test_values_and_defaults() -> None:
    assert build(Outer, {"inner": {"near_m": 3}}) == Outer(inner=Inner(near_m=3.0))
    assert build(Outer, as_mapping(Outer())) == Outer()
    assert as_mapping(Outer()) == {"name": "x", "inner": {"near_m": 1.0, "sizes": [1, 2]}, "parts": []}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"nme": "a"}, "unknown key nme; did you mean name?"),
        ({"inner": {"near": 1}}, "unknown key inner.near; did you mean inner.near_m?"),
        ({"inner": {"near_m": "far"}}, "inner.near_m: .*number.* got 'far'"),
        ({"inner": 3}, "inner"),
        ({"name": 10**5000}, "name: .* got an integer of too many digits"),
        ({10**5000: 1}, "unknown key an integer of too many digits"),
        ({"parts": [{}, {"neer_m": 1}]}, r"unknown key parts.1..neer_m; did you mean parts.1..near_m."),
    ],
)
def test_mistakes_are_named(values: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        build(Outer, values, "drive.yaml")


def test_a_config_may_refuse_what_does_not_fit_together() -> None:
    with pytest.raises(RadcamDepthError, match="a name is needed"):
        build(Outer, {"name": ""})


@pytest.mark.parametrize(
    "text", ["- 1\n", "a: [", "3\n", "a: 2001-99-99", f"a: {'9' * 5000}", "!!bool 3", f"a: {'[' * 3000}"]
)
def test_files_that_are_no_mapping(tmp_path: Path, text: str) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=r"x\.yaml"):
        load(Outer, path)
    with pytest.raises(ConfigurationError, match="No such file"):
        load(Outer, tmp_path / "missing.yaml")
