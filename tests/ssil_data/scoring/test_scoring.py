"""A scoring run is reproducible, streamed, bound to its dataset, and refuses what it cannot do."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssil_data.demonstrations import Pairs, join_pairs
from ssil_data.errors import ConflictError, InvalidInputError
from ssil_data.estimators import ESTIMATORS, GPR, MDN, VAE, WindowVAE
from ssil_data.features import Standardizer
from ssil_data.scales import Conformal, MinMax
from ssil_data.scoring import LeverageModel, preset, rescore, score, split_held_out
from ssil_data.scoring.streaming import add_margins, stream
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives

KINDS = sorted(ESTIMATORS)


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_bytes(dataset: Dataset, kind: str):
    estimator = ESTIMATORS[kind]()
    runs = [score(dataset, estimator, seed=seed, run=f"r{i}") for i, seed in enumerate((3, 3, 4))]
    first, again, other = (dataset.runs.values(run.name) for run in runs)
    assert first.equals(again)
    assert runs[0].model == runs[1].model
    if kind != "gpr":
        assert not first.equals(other)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["default", "paper"])
def test_every_preset_of_every_estimator_scores_every_pair(dataset: Dataset, kind: str, name: str):
    recipe = preset(name, kind)
    run = score(dataset, recipe.estimator, scale=recipe.scale, labeled_is_one=recipe.labeled_is_one)
    assert (run.preset, run.name, run.pairs, run.labeled) == (name, kind, len(dataset), 120)
    leverage = dataset.leverage(run.name)
    assert leverage.shape == (len(dataset),)
    assert (leverage >= 0).all()
    assert (leverage <= 1).all()
    labeled = dataset.per_pair("labeled").astype(bool)
    assert (leverage[labeled] == 1).all() == (name == "paper")
    tier = dataset.per_pair("tier")
    assert leverage[~labeled & (tier == "expert")].mean() > leverage[tier == "0-25"].mean()


@pytest.mark.parametrize("kind", KINDS)
def test_the_stored_model_gives_pairs_the_leverage_of_the_run(dataset: Dataset, kind: str):
    run = score(dataset, ESTIMATORS[kind]())
    scored = LeverageModel.of(dataset, run.name)(dataset.pairs())
    np.testing.assert_array_equal(scored.leverage, dataset.leverage(run.name))
    values = dataset.runs.values(run.name)
    np.testing.assert_array_equal(scored.uncertainty, values["uncertainty"])
    for part in ("aleatoric", "epistemic"):
        assert (part in scored.parts) == (values[part].null_count == 0)


def test_a_fitted_model_scores_another_dataset_unchanged(dataset: Dataset, store: Store):
    run = score(dataset, WindowVAE(), scale=MinMax())
    other = store.create(
        "other", [drive(50, 40)], state_names=STATE_NAMES, action_names=ACTION_NAMES
    )
    again = rescore(other, dataset, run.name)
    expected = LeverageModel.of(dataset, run.name)(other.pairs()).leverage
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
    run = score(made, VAE(), scale=Conformal(held_out=0.5))
    fresh = made.leverage(run.name)[~made.per_pair("labeled").astype(bool)]
    assert 0.35 < fresh.mean() < 0.65


@given(st.integers(1, 50), st.integers(1, 7), st.integers(0, 2))
def test_margins_are_the_neighbouring_rows(count: int, size: int, margin: int):
    rows = np.arange(count)
    pairs = Pairs(rows[:, None], rows[:, None], rows // 5, rows % 5)
    batches = [pairs[i : i + size] for i in range(0, count, size)]
    inner = []
    for (batch, own), plain in zip(add_margins(batches, margin), batches, strict=True):
        np.testing.assert_array_equal(batch[own].states, plain.states)
        assert own.start == min(margin, int(plain.states[0, 0]), size)
        inner.append(batch[own])
    np.testing.assert_array_equal(join_pairs(inner).states, pairs.states)


@pytest.mark.parametrize("kind", KINDS)
def test_the_stream_does_not_depend_on_its_batches(dataset: Dataset, kind: str):
    fitted = ESTIMATORS[kind]().fit(dataset.labeled(), seed=0)
    pairs = dataset.pairs()
    expected = Standardizer.of(pairs.states)
    for rows in (1, 13, 10_000):
        seen: list[int] = []
        answer = stream(dataset.batches(rows=rows), fitted, count=len(pairs), seen=seen.append)
        # a Gaussian process takes small variances from large ones, in float32
        tolerance = 5e-3 if kind == "gpr" else 2e-4
        expected_total = fitted.uncertainty(pairs).total
        np.testing.assert_allclose(answer.uncertainty, expected_total, rtol=tolerance, atol=1e-5)
        found = Standardizer.of_moments(answer.mean, answer.variance)
        np.testing.assert_allclose(found.scale, expected.scale, rtol=1e-6)
        np.testing.assert_array_equal(answer.sample, pairs.states)
        assert seen[-1] == len(pairs)


def test_a_held_out_split_keeps_episodes_whole():
    episode = np.repeat(np.arange(10), 30)
    step = np.tile(np.arange(30), 10)
    pairs = Pairs(np.ones((300, 2)), np.ones((300, 1)), episode, step)
    fit, held_out = split_held_out(pairs, share=0.2, seed=1)
    assert not set(fit.episode) & set(held_out.episode)
    assert len(fit) + len(held_out) == 300
    assert len(held_out) in (60, 90)
    fit, held_out = split_held_out(pairs[:30], share=0.2, seed=1)
    assert (len(fit), len(held_out)) == (24, 6)


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


def test_unknown_presets_and_estimators_are_refused():
    with pytest.raises(InvalidInputError, match="found 'best'"):
        preset("best", "vae")
    with pytest.raises(InvalidInputError, match="found 'pca'"):
        preset("paper", "pca")
    with pytest.raises(InvalidInputError, match="expected the estimator mdn or gpr, found vae"):
        preset("paper", "vae").with_options(scale=None, surprisal=True)


def test_scores_do_not_depend_on_true_quality(store: Store):
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    told = store.create("told", drives(), **names)
    untold = store.create(
        "untold",
        [type(e)(e.states, e.actions, labeled=e.labeled) for e in drives()],
        **names,
    )
    for made in (told, untold):
        score(made, VAE(), run="vae")
    np.testing.assert_array_equal(told.leverage("vae"), untold.leverage("vae"))
