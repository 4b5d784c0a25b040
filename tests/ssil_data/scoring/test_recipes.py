"""Recipes are values: named, made by hand, or read from a run."""

import json
from dataclasses import replace

import pytest

from ssil_data.errors import InvalidInputError
from ssil_data.estimators import ESTIMATORS, MDN, VAE
from ssil_data.scales import Conformal, Quantile
from ssil_data.scoring import PRESETS, Recipe, preset, score
from ssil_data.store.dataset import Dataset

KINDS = sorted(ESTIMATORS)


def test_unknown_presets_and_estimators_are_refused():
    with pytest.raises(InvalidInputError, match="found 'best'"):
        preset("best", "vae")
    with pytest.raises(InvalidInputError, match="found 'pca'"):
        preset("paper", "pca")
    with pytest.raises(InvalidInputError, match="expected the estimator mdn or gpr, found vae"):
        preset("paper", "vae").with_options(scale=None, surprisal=True)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", PRESETS)
def test_a_recipe_made_by_hand_of_a_presets_choices_is_the_preset(kind: str, name: str):
    named = preset(name, kind)
    by_hand = Recipe(named.estimator, named.scale, named.labeled_is_one)
    assert by_hand == named
    assert by_hand.preset == named.preset == name


def test_an_option_that_changes_a_choice_ends_the_presets_name():
    named = preset("default", "mdn")
    assert named.with_options(scale="minmax", surprisal=None).preset is None
    assert named.with_options(scale=None, surprisal=False).preset is None
    assert named.with_options(scale="quantile", surprisal=True).preset == "default"
    assert replace(named, estimator=MDN(steps=1)).preset is None


def test_an_estimator_alone_goes_with_the_quantile_scale():
    recipe = Recipe.of(VAE(latent=2))
    assert recipe == Recipe(VAE(latent=2), Quantile(), labeled_is_one=False)
    assert Recipe.of(recipe) is recipe


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", PRESETS)
def test_a_recipe_survives_json(kind: str, name: str):
    recipe = preset(name, kind)
    assert Recipe.from_json(json.loads(json.dumps(recipe.to_json()))) == recipe


def test_a_run_gives_back_the_recipe_it_was_made_by(dataset: Dataset):
    recipe = Recipe(VAE(steps=5), Conformal(held_out=0.5), labeled_is_one=True)
    run = score(dataset, recipe)
    assert Recipe.of_run(run) == recipe
    assert run.preset is None
