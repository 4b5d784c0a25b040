"""Recipes are values: named, made by hand, or read from a run."""

import json
from dataclasses import replace
from typing import Any

import pytest

from ssil_data.errors import InvalidInputError
from ssil_data.estimators import ESTIMATORS, MDN, VAE, Ensemble
from ssil_data.pooling import HiddenMarkov, NoPooling, Window
from ssil_data.scales import Conformal, Posterior, Quantile
from ssil_data.scoring import PRESETS, Recipe, preset, score
from ssil_data.scoring.presets import PAPER_KINDS
from ssil_data.store.dataset import Dataset

NAMED = [
    (name, kind)
    for name in PRESETS
    for kind in (PAPER_KINDS if name == "paper" else sorted(ESTIMATORS))
]
every_preset = pytest.mark.parametrize(("name", "kind"), NAMED)


def test_unknown_presets_and_estimators_are_refused():
    with pytest.raises(InvalidInputError, match="found 'best'"):
        preset("best", "vae")
    with pytest.raises(InvalidInputError, match="found 'pca'"):
        preset("paper", "pca")
    with pytest.raises(InvalidInputError, match="expected the estimator mdn or gpr, found vae"):
        preset("paper", "vae").with_options(scale=None, surprisal=True)


@every_preset
def test_a_recipe_made_by_hand_of_a_presets_choices_is_the_preset(name: str, kind: str):
    named = preset(name, kind)
    by_hand = Recipe(
        named.estimator,
        named.scale,
        labeled_is_one=named.labeled_is_one,
        pooling=named.pooling,
        scale_floor=named.scale_floor,
        cross_fit=named.cross_fit,
    )
    assert by_hand == named
    assert by_hand.preset == named.preset == name


def test_an_option_that_changes_a_choice_ends_the_presets_name():
    named = preset("default", "mdn")
    assert named.with_options(scale="minmax", surprisal=None).preset is None
    assert named.with_options(scale=None, surprisal=False).preset is None
    assert named.with_options(scale="posterior", surprisal=True).preset == "default"
    assert named.with_options(scale="quantile").preset is None
    assert named.with_options(pooling="window").preset == "default"
    assert named.with_options(pooling="hmm").preset is None
    assert named.with_options(expert_share=0.2).preset is None
    assert replace(named, estimator=MDN(steps=1)).preset is None


def test_an_estimator_alone_goes_with_the_quantile_scale():
    recipe = Recipe.of(VAE(latent=2))
    assert recipe == Recipe(VAE(latent=2), Quantile(), labeled_is_one=False)
    assert Recipe.of(recipe) is recipe


@every_preset
def test_a_recipe_survives_json(name: str, kind: str):
    recipe = preset(name, kind)
    assert Recipe.from_json(json.loads(json.dumps(recipe.to_json()))) == recipe


def test_a_run_gives_back_the_recipe_it_was_made_by(dataset: Dataset):
    recipe = Recipe(VAE(steps=5), Conformal(held_out=0.5), labeled_is_one=True)
    run = score(dataset, recipe)
    assert Recipe.of_run(run) == recipe
    assert run.preset is None


def test_the_default_preset_is_the_ensemble_pooled_as_a_chance():
    recipe = preset("default")
    assert isinstance(recipe.estimator, Ensemble)
    assert recipe == Recipe(
        Ensemble(), Posterior(), pooling=Window(), scale_floor=0.3, cross_fit=True
    )
    assert recipe.preset == "default"


@pytest.mark.parametrize("kind", ["contrast", "ensemble"])
def test_the_paper_has_no_preset_for_estimators_that_it_does_not_know(kind: str):
    with pytest.raises(InvalidInputError, match=f"preset paper: .* found {kind!r}"):
        preset("paper", kind)


def test_a_record_of_the_first_version_has_a_recipe_with_what_came_later_off():
    old = {"estimator": {"kind": "vae"}, "scale": {"kind": "minmax"}, "labeled_is_one": True}
    recipe = Recipe.from_json({**old, "seed": 3, "alpha": 1.0})
    assert recipe == preset("paper", "vae")
    assert (recipe.pooling, recipe.scale_floor) == (NoPooling(), 0.0)
    assert not recipe.cross_fit and not recipe.self_training and not recipe.needs_sample


@pytest.mark.parametrize(
    "change",
    [
        {"scale_floor": -0.1},
        {"scale_floor": float("nan")},
        {"scale_floor": "much"},
        {"cross_fit": 1},
        {"self_training": "yes"},
        {"pooling": {"kind": "median"}},
        {"pooling": {"kind": "window", "half_width": 0}},
        {"pooling": {"kind": "hmm", "bins": 1}},
        {"scale": {"kind": "posterior", "expert_share": 1}},
        {"scale": {"kind": "posterior", "expert_share": "half"}},
    ],
)
def test_a_value_that_does_not_fit_is_refused(change: dict):
    with pytest.raises(InvalidInputError):
        Recipe.from_json({**preset("default").to_json(), **change})


@pytest.mark.parametrize("wrong", [None, [], "gpr", 10**400])
def test_what_is_no_object_is_no_recipe(wrong: Any):
    with pytest.raises(InvalidInputError, match="recipe: expected a JSON object, found "):
        Recipe.from_json(wrong)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"estimator": "vae"}, r"such as sd.WindowVAE\(\), found 'vae'"),
        ({"scale": "posterior"}, r"such as sd.Posterior\(\), found 'posterior'"),
        ({"pooling": "window"}, r"such as sd.Window\(\), found 'window'"),
        (
            {"pooling": Quantile()},
            r"pooling: expected pooling settings .*, found Quantile\(low=0.05",
        ),
        ({"pooling": None}, "found None"),
        ({"cross_fit": "no"}, "cross_fit: expected true or false, found 'no'"),
        ({"scale_floor": 10**400}, "expected 0 or more, found a whole number of 1,329 bits"),
        ({"scale_floor": float("inf")}, "scale_floor: .* found inf"),
    ],
)
def test_a_part_of_another_type_is_one_message(parts: dict[str, Any], message: str):
    with pytest.raises(InvalidInputError, match=message):
        Recipe(**{"estimator": VAE(), **parts})


def test_options_choose_pooling_and_a_known_share():
    recipe = preset("default").with_options(pooling="hmm", expert_share=0.25)
    assert (recipe.pooling, recipe.scale) == (HiddenMarkov(), Posterior(0.25))
    with pytest.raises(InvalidInputError, match="only the posterior scale takes one"):
        preset("default").with_options(scale="quantile", expert_share=0.25)
