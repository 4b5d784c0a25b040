"""Data that leverage cannot be learned from: `weak` says why, or one clear refusal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import ssil_data as sd
from ssil_data.demonstrations import Episode
from ssil_data.estimators import MDN, Contrast, Ensemble, WindowVAE
from ssil_data.quality import auroc
from ssil_data.scoring.recipes import Recipe, preset
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import Run
from support.demonstrations import ACTION_NAMES, DATASETS, STATE_NAMES, drive

DEFAULT = replace(
    preset("default"),
    estimator=Ensemble((MDN(steps=40, surprisal=True), WindowVAE(steps=40), Contrast(steps=40))),
)
"""The default recipe, learned for a shorter time and without the Gaussian process."""

RECIPES = {
    "default": DEFAULT,
    "hmm": DEFAULT.with_options(pooling="hmm"),
    "contrast": replace(preset("default", "contrast"), estimator=Contrast(steps=40)),
}
every_recipe = pytest.mark.parametrize("recipe", RECIPES.values(), ids=RECIPES)


def pool() -> list[Episode]:
    expert = [drive(10 + seed, 50, tier="expert") for seed in range(3)]
    return [*expert, *(drive(30 + seed, 50, spread=4, tier="0-25") for seed in range(4))]


def repeat(rows: int, count: int, *, noise: float = 0.0) -> Episode:
    """Return a labeled episode of the same few pairs again and again."""
    first = drive(0, rows, labeled=True)
    row = np.arange(count) % rows
    rng = np.random.default_rng(0)
    states = first.states[row] + noise * rng.normal(size=(count, 3))
    actions = first.actions[row] + noise * rng.normal(size=(count, 2))
    return Episode(states.astype(np.float32), actions.astype(np.float32), labeled=True)


def with_heading(episode: Episode, heading: float) -> Episode:
    states = np.array(episode.states)
    states[:, 2] = heading
    return replace(episode, states=states)


def store_and_score(
    store: Store, episodes: list[Episode], recipe: Recipe, name: str = "bad"
) -> tuple[Dataset, Run]:
    dataset = store.create(name, episodes, state_names=STATE_NAMES, action_names=ACTION_NAMES)
    return dataset, sd.score(dataset, recipe, seed=400)


def two_drives() -> list[Episode]:
    return [drive(seed, 60, labeled=True) for seed in range(2)]


CASES: dict[str, tuple[Callable[[], list[Episode]], str]] = {
    "one labeled episode": (
        lambda: [drive(0, 60, labeled=True), *pool()],
        "all labeled pairs are of one episode",
    ),
    "labeled pairs all alike": (
        lambda: [repeat(1, 60), *pool()],
        "60 labeled pairs, but only 1 different ones",
    ),
    "two labeled pairs": (
        lambda: [drive(0, 2, labeled=True), *pool()],
        "2 labeled pairs: too few to know the expert by",
    ),
    "duplicates with noise": (
        lambda: [repeat(4, 60, noise=1e-7), *pool()],
        "60 labeled pairs, but only 4 different ones",
    ),
    "a dimension constant in the labels and off elsewhere": (
        lambda: [
            *(with_heading(each, 0.0) for each in two_drives()),
            *(with_heading(each, 1e-6) for each in pool()),
        ],
        "state dimension 2 is 0 in all labeled pairs and hardly ever elsewhere",
    ),
    "one unlabeled pair": (
        lambda: [*two_drives(), drive(10, 1)],
        "1 unlabeled pairs: too few to compare the expert with",
    ),
    "two unlabeled pairs": (
        lambda: [*two_drives(), drive(10, 2)],
        "2 unlabeled pairs: too few to compare the expert with",
    ),
    "unlabeled pairs all alike": (
        lambda: [*two_drives(), replace(repeat(1, 60), labeled=False)],
        "leverage hardly differs between unlabeled pairs",
    ),
    "unlabeled pairs are copies of the labeled": (
        lambda: [drive(0, 60, labeled=True), *(drive(0, 60) for _ in range(3))],
        "held-out experts are not told from the pool",
    ),
}


@every_recipe
@pytest.mark.parametrize("case", CASES)
def test_a_run_on_bad_data_is_finite_and_weak_and_says_why(store: Store, recipe: Recipe, case: str):
    make, reason = CASES[case]
    dataset, run = store_and_score(store, make(), recipe)
    leverage = dataset.leverage(run.name)
    assert np.isfinite(leverage).all() and (leverage >= 0).all() and (leverage <= 1).all()
    assert any(reason in text for text in run.weak), run.weak
    assert dataset.runs[run.name] == run
    assert run.expert_share is not None and run.expert_share_interval is not None
    low, high = run.expert_share_interval
    assert 0 <= low <= run.expert_share <= high <= 1


@every_recipe
def test_without_an_unlabeled_pair_scoring_is_refused_with_what_to_do(store: Store, recipe: Recipe):
    with pytest.raises(sd.InvalidInputError, match=r"every pair is labeled.* --scale conformal"):
        store_and_score(store, two_drives(), recipe)
    assert list(store["bad"].runs) == []


def test_what_the_refusal_advises_works_and_is_weak(store: Store):
    recipe = preset("default", "windowvae").with_options(scale="conformal")
    recipe = replace(recipe, estimator=WindowVAE(steps=40))
    dataset, run = store_and_score(store, two_drives(), recipe)
    assert np.isfinite(dataset.leverage(run.name)).all()
    assert "no pair is unlabeled, so there is nothing to compare with" in run.weak


@pytest.mark.parametrize("share", [0.001, 0.999])
def test_a_share_at_its_bound_is_weak(store: Store, share: float):
    recipe = DEFAULT.with_options(expert_share=share)
    dataset, run = store_and_score(store, [*two_drives(), *pool()], recipe)
    assert np.isfinite(dataset.leverage(run.name)).all()
    assert any("is at its bound" in text for text in run.weak)


@every_recipe
def test_a_pool_of_experts_alone_gets_no_confident_leverage_of_one(store: Store, recipe: Recipe):
    experts = [drive(50 + seed, 50, tier="expert") for seed in range(5)]
    dataset, run = store_and_score(store, [*two_drives(), *experts], recipe)
    assert np.isfinite(dataset.leverage(run.name)).all()
    assert any("held-out experts are not told from the pool" in text for text in run.weak)


def test_a_broken_sensor_in_the_pool_does_not_hide_the_dimension(store: Store):
    """Five rows of 1e20 among 355: unbounded, the floor would be 3e18 for every dimension."""
    broken = Episode(np.full((5, 3), 1e20, np.float32), np.zeros((5, 2), np.float32))
    clean, run = store_and_score(store, [*two_drives(), *pool()], DEFAULT)
    without = tell_experts(clean, run)
    dataset, run = store_and_score(store, [*two_drives(), *pool(), broken], DEFAULT, "broken")
    assert without > 0.55
    assert tell_experts(dataset, run) > without - 0.03
    assert dataset.leverage(run.name)[-5:].max() < 0.05


def tell_experts(dataset: Dataset, run: Run) -> float:
    """Return the chance that an expert's pair has more leverage than one of the worst drives."""
    leverage = dataset.leverage(run.name)
    tier = dataset.per_pair("tier")
    return auroc(leverage[tier == "expert"], leverage[tier == "0-25"])


def noise(seed: int, rows: int, *, labeled: bool = False) -> Episode:
    rng = np.random.default_rng(seed)
    states = rng.normal(size=(rows, 3)).astype(np.float32)
    return Episode(states, rng.normal(size=(rows, 2)).astype(np.float32), labeled=labeled)


def test_noise_is_weak_whatever_share_is_found_in_it(store: Store):
    """A useless run may find that nearly all are experts, which must not excuse it."""
    for seed in range(400, 410):
        episodes = [
            *(noise(1000 * seed + number, 60, labeled=True) for number in range(2)),
            *(noise(1000 * seed + 50 + number, 60) for number in range(8)),
        ]
        dataset = store.create(
            f"noise-{seed}", episodes, state_names=STATE_NAMES, action_names=ACTION_NAMES
        )
        run = sd.score(dataset, RECIPES["contrast"], seed=seed)
        assert run.weak, (seed, run.expert_share, run.held_out_auroc)


def copy(source: Dataset, number: int) -> Episode:
    pairs = source.episode(number)
    known = bool(source.episodes["labeled"][number].as_py())
    return Episode(pairs.states, pairs.actions, labeled=known)


def test_good_data_are_not_weak(store: Store):
    source = Store(DATASETS)["racetrack"]
    labeled = np.flatnonzero(source.episodes["labeled"].to_numpy())
    others = np.setdiff1d(np.arange(len(source.episodes)), labeled)[::4]
    dataset = store.create(
        "good",
        [copy(source, int(number)) for number in [*labeled, *others]],
        state_names=source.state_names,
        action_names=source.action_names,
    )
    run = sd.score(dataset, DEFAULT, seed=400)
    assert run.weak == ()


def test_a_run_made_from_a_weak_one_is_as_weak(store: Store):
    dataset, run = store_and_score(store, [drive(0, 20, labeled=True), *pool()], DEFAULT)
    assert len(run.weak) >= 2
    other = store.create(
        "other",
        [*two_drives(), *pool()],
        state_names=STATE_NAMES,
        action_names=ACTION_NAMES,
    )
    again = sd.rescore(other, dataset, run.name)
    assert set(again.weak) >= set(run.weak)
    assert (again.labeled, again.labeled_episodes) == (20, 1)
    assert again.held_out_auroc == run.held_out_auroc
