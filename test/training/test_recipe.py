from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from radcam_depth_ros import configuration
from radcam_depth_ros.networks import registry
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.registry import Criterion
from radcam_depth_ros.training.precision import Precision
from radcam_depth_ros.training.recipe import FINE_TUNING, OptimiserConfig, StageConfig, TrainingConfig, recipe_of

RECIPES = sorted((Path(__file__).parents[2] / "config" / "train").glob("*.yaml"))


@pytest.mark.parametrize("path", RECIPES, ids=lambda path: path.stem)
def test_shipped_recipes_fit_their_networks(path: Path) -> None:
    recipe = configuration.load(TrainingConfig, path)
    network = "baff" if path.stem == "fine_tune" else path.stem
    assert registry.create_config(network, recipe.architecture)
    assert Criterion.of(network, recipe.loss)


def test_the_shipped_recipe_of_baff_is_the_default() -> None:
    recipe = configuration.load(TrainingConfig, next(path for path in RECIPES if path.stem == "baff"))
    known = dataclasses.replace(recipe, loss={})
    assert configuration.as_mapping(known) == configuration.as_mapping(TrainingConfig())
    assert Criterion.of("baff", recipe.loss) == Criterion.of("baff", {})


@pytest.mark.parametrize("network", ["cafnet", "lircdepth", "structured"])
def test_the_shipped_recipes_of_other_networks_are_theirs_by_name(network: str) -> None:
    recipe = configuration.load(TrainingConfig, next(path for path in RECIPES if path.stem == network))
    assert recipe == recipe_of(network)


def test_the_shipped_recipe_of_fine_tuning_is_that_of_initial_weights() -> None:
    recipe = configuration.load(TrainingConfig, next(path for path in RECIPES if path.stem == "fine_tune"))
    assert recipe == FINE_TUNING


def test_what_is_measured_of_the_precision_is_kept() -> None:
    assert TrainingConfig(precision="bfloat16").with_chosen_precision().precision == "bfloat16"
    assert TrainingConfig().with_chosen_precision().precision in ("float32", "bfloat16")


def test_stages_follow_one_another() -> None:
    config = TrainingConfig(stages=(StageConfig(0.7, ((32, 64),), 4), StageConfig(0.3, ((64, 96),), 2)))
    assert [config.stage(progress).batch for progress in (0.0, 0.69, 0.71, 1.0)] == [4, 4, 2, 2]


def test_learning_rates() -> None:
    cosine = OptimiserConfig(1e-3, "cosine", final_share=0.1, warm_up_iterations=10)
    assert cosine.rate(0, 0.0) == pytest.approx(1e-4)
    assert cosine.rate(100, 0.5) == pytest.approx(1e-3 * 0.55)
    assert cosine.rate(1000, 1.0) == pytest.approx(1e-4)
    step = OptimiserConfig(2e-4, "step", warm_up_iterations=0)
    assert [step.rate(9, progress) for progress in (0.5, 0.9)] == pytest.approx([2e-4, 1e-4])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"stages": [{"share": 0.5, "crops": [[64, 64]], "batch": 1}]}, "sum to 1"),
        ({"stages": [{"share": 1, "crops": [[60, 64]], "batch": 1}]}, "multiples of 32"),
        ({"stages": [{"share": 1, "crops": [[64, 64]], "batch": 0}]}, "a batch"),
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
        configuration.build(TrainingConfig, wrong)


def test_an_unknown_key_is_told_with_its_neighbour() -> None:
    with pytest.raises(configuration.ConfigurationError, match="learning_rate"):
        configuration.build(TrainingConfig, {"optimiser": {"learnin_rate": 1e-3}})


def test_a_device_that_is_not_there_is_refused() -> None:
    with pytest.raises(TrainingError, match="device"):
        Precision.choose("auto", "abacus")
