"""A scoring run is reproducible, bound to its dataset, and refuses what it cannot do."""

from pathlib import Path

import numpy as np
import pytest

from ssil_data.errors import ConflictError, InvalidInputError
from ssil_data.estimators import (
    ESTIMATORS,
    GPR,
    MDN,
    VAE,
    Contrast,
    Ensemble,
    Estimator,
    WindowVAE,
)
from ssil_data.scales import Conformal, MinMax
from ssil_data.scoring import Recipe, preset, rescore, score
from ssil_data.scoring.presets import PAPER_KINDS
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives

KINDS = sorted(ESTIMATORS)

QUICK: dict[str, Estimator] = {
    "vae": VAE(steps=40),
    "windowvae": WindowVAE(steps=40),
    "mdn": MDN(steps=40),
    "gpr": GPR(),
    "contrast": Contrast(steps=40),
    "ensemble": Ensemble((VAE(steps=40), Contrast(steps=40))),
}
"""Every kind, learned for a shorter time."""


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_bytes(dataset: Dataset, kind: str):
    runs = [score(dataset, QUICK[kind], seed=seed, run=f"r{i}") for i, seed in enumerate((3, 3, 4))]
    first, again, other = (dataset.runs.values(run.name) for run in runs)
    assert first.equals(again)
    assert runs[0].model == runs[1].model
    if kind != "gpr":
        assert not first.equals(other)


@pytest.mark.parametrize(
    ("name", "kind"),
    [*(("default", kind) for kind in KINDS), *(("paper", kind) for kind in PAPER_KINDS)],
)
def test_every_preset_of_every_estimator_scores_every_pair(dataset: Dataset, name: str, kind: str):
    recipe = preset(name, kind)
    run = score(dataset, recipe)
    assert (run.preset, run.name, run.pairs, run.labeled) == (name, kind, len(dataset), 120)
    leverage = dataset.leverage(run.name)
    assert leverage.shape == (len(dataset),)
    assert (leverage >= 0).all()
    assert (leverage <= 1).all()
    labeled = dataset.per_pair("labeled").astype(bool)
    assert (leverage[labeled] == 1).all() == (name == "paper")
    tier = dataset.per_pair("tier")
    assert leverage[~labeled & (tier == "expert")].mean() > leverage[tier == "0-25"].mean()


def test_a_fitted_model_scores_another_dataset_unchanged(dataset: Dataset, store: Store):
    run = score(dataset, Recipe(QUICK["windowvae"], MinMax()))
    other = store.create(
        "other", [drive(50, 40)], state_names=STATE_NAMES, action_names=ACTION_NAMES
    )
    again = rescore(other, dataset, run.name)
    expected = dataset.model(run.name)(other.pairs()).leverage
    np.testing.assert_array_equal(other.leverage(again.name), expected)
    assert again.model == run.model
    assert again.fitted_scale == run.fitted_scale


def test_a_fitted_model_scores_the_next_version_of_its_dataset(dataset: Dataset):
    run = score(dataset, GPR())
    newer = dataset.append([drive(99, 7)])
    again = rescore(newer, newer, run.name)
    assert (again.name, again.dataset_version, again.pairs) == ("gpr-2", newer.version, 427)


def test_runs_without_a_name_that_end_at_once_take_different_ones(dataset: Dataset):
    def another(what: str, done: int, of: int) -> None:
        if what == "score" and done == of:
            score(dataset, GPR())

    assert score(dataset, GPR(), progress=another).name in ("gpr", "gpr-2")
    assert sorted(dataset.runs.names()) == ["gpr", "gpr-2"]


def test_conformal_leverage_of_fresh_expert_pairs_is_near_uniform(store: Store):
    expert = [drive(seed, 80, labeled=seed < 20) for seed in range(60)]
    made = store.create("e", expert, state_names=STATE_NAMES, action_names=ACTION_NAMES)
    run = score(made, Recipe(VAE(), Conformal(held_out=0.5)))
    fresh = made.leverage(run.name)[~made.per_pair("labeled").astype(bool)]
    assert 0.35 < fresh.mean() < 0.65


def test_a_dataset_without_a_labeled_episode_is_refused(store: Store):
    plain = store.create("plain", [drive(0, 9)], state_names=STATE_NAMES, action_names=ACTION_NAMES)
    with pytest.raises(InvalidInputError, match="labeled episodes of plain: expected at least one"):
        score(plain, VAE())
    assert list(plain.runs) == []
    assert not (Path(plain.folder.uri) / "models").exists()


def test_a_taken_name_is_refused_before_anything_is_fitted(dataset: Dataset, monkeypatch):
    score(dataset, GPR(), run="mine")
    monkeypatch.setattr(MDN, "fit", None)
    with pytest.raises(ConflictError, match="the name 'mine' is taken"):
        score(dataset, MDN(), run="mine")


def test_runs_are_numbered_unless_they_are_named(dataset: Dataset):
    assert [score(dataset, GPR()).name for _ in range(3)] == ["gpr", "gpr-2", "gpr-3"]


def test_scores_do_not_depend_on_true_quality(store: Store):
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    known = store.create("known", drives(), **names)
    unknown = store.create(
        "unknown",
        [type(e)(e.states, e.actions, labeled=e.labeled) for e in drives()],
        **names,
    )
    for made in (known, unknown):
        score(made, QUICK["vae"], run="vae")
    np.testing.assert_array_equal(known.leverage("vae"), unknown.leverage("vae"))
