from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from small_training import RECIPE

from radcam_depth_ros import configuration, recipes
from radcam_depth_ros.networks import registry
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.registry import Criterion
from radcam_depth_ros.training.precision import Precision
from radcam_depth_ros.training.recipe import (
    FINE_TUNING,
    PhaseConfig,
    RecipeWarning,
    TrainingConfig,
    build,
    load,
    recipe_of,
)

NAMES = [*(name for name in registry.names() if registry.trained_as(name) == name), FINE_TUNING]


@pytest.mark.parametrize("name", NAMES)
def test_shipped_recipes_fit_their_networks(name: str) -> None:
    recipe = recipe_of(name)
    network = "baff" if name == FINE_TUNING else name
    assert registry.create_config(network, recipe.architecture)
    assert Criterion.of(network, recipe.loss)


NUSCENES = {"nuscenes": "baff", **{f"nuscenes_{name}": name for name in ("structured", "lircdepth", "cafnet")}}


@pytest.mark.parametrize(("name", "network"), NUSCENES.items())
def test_recipes_of_nuscenes_have_the_truth_of_the_papers(name: str, network: str) -> None:
    path = recipes.shipped(name)
    assert path is not None
    recipe = load(path)
    assert registry.create_config(network, recipe.architecture)
    assert Criterion.of(network, recipe.loss)
    truth = recipe.accumulation
    assert (truth.scans, truth.outlier_kernel_px, truth.outlier_m, truth.interpolate) == (80, 7, 1.5, True)
    assert recipe.device == "cuda"
    # Epochs of the 27,430 training frames: [Electronics2025], [Li2023], public code of [Sun2025] and of [Sun2024].
    epochs = {"baff": 470, "structured": 30, "lircdepth": 200, "cafnet": 200}[network]
    assert recipe.iterations == epochs * math.ceil(27_430 / recipe.phases[0].batch)


def test_the_rate_falls_at_the_milestones_of_the_papers() -> None:
    path = recipes.shipped("nuscenes_structured")
    assert path is not None
    rate = load(path).optimiser.rate
    epochs = [rate(10_000, (epoch + 0.5) / 30) for epoch in (0, 4, 5, 9, 10, 29)]
    assert epochs == pytest.approx([5e-4, 5e-4, 5e-5, 5e-5, 5e-6, 5e-9])


def test_milestones_that_do_not_ascend_are_refused() -> None:
    for values in ({"milestones": [0.5, 0.2]}, {"decay": 0.0}, {"decay": 1.5}):
        with pytest.raises(TrainingError, match="milestones"):
            build({"optimiser": values})


def test_the_recipe_of_baff_has_every_value_once() -> None:
    path = recipes.shipped("baff")
    assert path is not None
    values = configuration.read(path)
    assert configuration.as_mapping(build({})) == configuration.as_mapping(
        configuration.build(TrainingConfig, {**values, "loss": {}})
    )


def test_a_recipe_says_what_differs(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("optimiser: {learning_rate: 0.5}\nrehearsal: {simulation: {}}")
    recipe = load(path)
    assert recipe.optimiser == replace(RECIPE.optimiser, learning_rate=0.5)
    assert recipe.rehearsal == replace(RECIPE.rehearsal, simulation={})
    assert replace(recipe, optimiser=RECIPE.optimiser, rehearsal=RECIPE.rehearsal) == RECIPE


def test_networks_have_recipes_of_their_own() -> None:
    assert recipe_of("cafnet").optimiser.learning_rate == 5e-4
    assert recipe_of("baff_paper") == recipe_of("baseline") == recipe_of("baff") == RECIPE
    assert recipe_of(FINE_TUNING).rehearsal.share == 0.5


def test_what_is_measured_of_the_precision_is_kept() -> None:
    assert replace(RECIPE, precision="bfloat16").with_chosen_precision().precision == "bfloat16"
    assert RECIPE.with_chosen_precision().precision in ("float32", "bfloat16")


def test_stages_follow_one_another() -> None:
    config = replace(RECIPE, phases=(PhaseConfig(0.7, ((32, 64),), 4), PhaseConfig(0.3, ((64, 96),), 2)))
    assert [config.phase(progress).batch for progress in (0.0, 0.69, 0.71, 1.0)] == [4, 4, 2, 2]


def test_learning_rates() -> None:
    cosine = replace(RECIPE.optimiser, learning_rate=1e-3, schedule="cosine", final_share=0.1, warm_up_iterations=10)
    assert cosine.rate(0, 0.0) == pytest.approx(1e-4)
    assert cosine.rate(100, 0.5) == pytest.approx(1e-3 * 0.55)
    assert cosine.rate(1000, 1.0) == pytest.approx(1e-4)
    polynomial = replace(cosine, schedule="polynomial")
    assert [polynomial.rate(1000, progress) for progress in (0.0, 0.5, 1.0)] == pytest.approx(
        [1e-3, 1e-4 + 9e-4 * 0.5**0.9, 1e-4]
    )
    step = replace(RECIPE.optimiser, learning_rate=2e-4, schedule="step", warm_up_iterations=0)
    assert [step.rate(9, progress) for progress in (0.5, 0.9)] == pytest.approx([2e-4, 1e-4])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"phases": [{"share": 0.5, "crops": [[64, 64]], "batch": 1}]}, "sum to 1"),
        ({"phases": [{"share": 1, "crops": [[60, 64]], "batch": 1}]}, "multiples of 32"),
        ({"phases": [{"share": 1, "crops": [[64, 64]], "batch": 0}]}, "a batch"),
        ({"optimiser": {"schedule": "linear"}}, "cosine"),
        ({"optimiser": {"learning_rate": -1}}, "learning_rate"),
        ({"optimiser": {"part_rates": {"road": -1}}}, "part_rates must not be negative, got -1"),
        ({"precision": "float16"}, "precision"),
        ({"validation": {"frames": 0}}, "validation needs"),
        ({"iterations": 0}, "at least 1"),
        ({"validation": {"patience": -1}}, "patience of at least 0"),
        ({"minutes": 0}, "minutes must be above 0"),
        ({"initial_share": 1.0}, "initial_share at least 0"),
        ({"rehearsal": {"share": 1.0}}, "a share of at least 0 and below 1"),
        ({"rehearsal": {"tolerance": -0.1}}, "a tolerance of at least 0, got .* and -0.1"),
        ({"rehearsal": {"frames": 10}}, "frames for two drives"),
        ({"rehearsal": {"first_seed": 999_990}}, "kept for measuring"),
        ({"augmentation": {"focal_jitter": 0.7}}, "focal_jitter 0 to 0.5, got 0.5 and 0.7"),
    ],
)
def test_wrong_recipes_are_refused(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(TrainingError, match=message):
        build(wrong)


def test_a_recipe_of_an_earlier_version_is_read() -> None:
    phases = [{"share": 1.0, "crops": [[64, 64]], "batch": 3}]
    with pytest.warns(RecipeWarning, match="stages are called phases now"):
        assert build({"stages": phases}) == build({"phases": phases})


def test_an_unknown_key_is_told_with_its_neighbour() -> None:
    with pytest.raises(configuration.ConfigurationError, match="learning_rate"):
        build({"optimiser": {"learnin_rate": 1e-3}})


def test_a_device_that_is_not_there_is_refused() -> None:
    with pytest.raises(TrainingError, match="device"):
        Precision.choose("auto", "abacus")
