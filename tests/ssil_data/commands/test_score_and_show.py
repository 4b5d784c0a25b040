"""score takes every choice of a recipe; score and show say what a run knows of itself."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssil_data.commands.health import describe_health, list_health
from ssil_data.commands.leverage import score
from ssil_data.commands.output import StoreLocation, _format
from ssil_data.commands.show import _list_chances, show
from ssil_data.errors import InvalidInputError
from ssil_data.estimators import GPR, VAE
from ssil_data.scoring import Recipe, preset
from ssil_data.scoring import score as score_dataset
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import Run
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives

HEALTH = {
    "pooling",
    "scale",
    "labeled",
    "labeled_episodes",
    "laps",
    "expert_share",
    "expert_share_interval",
    "effective_pairs",
    "weight_on_experts",
    "calibration_error",
    "held_out_auroc",
    "weak",
}


@pytest.fixture
def location(store: Store, dataset: Dataset) -> StoreLocation:
    return StoreLocation(store.folder.uri)


def read_json(capsys: pytest.CaptureFixture[str]) -> Any:
    return json.loads(capsys.readouterr().out)


def test_without_a_choice_the_ensemble_is_pooled_and_becomes_a_chance(
    location: StoreLocation, capsys: pytest.CaptureFixture[str]
):
    score("drives", location=location, json=True)
    run = read_json(capsys)
    assert (run["estimator"], run["preset"]) == ("ensemble", "default")
    assert (run["pooling"], run["scale"], run["scale_floor"]) == ("window", "posterior", 0.3)
    assert set(run) >= HEALTH


@pytest.mark.parametrize(
    ("choice", "expected"),
    [
        ({"pool": "hmm"}, {"pooling": "hmm"}),
        ({"pool": "none"}, {"pooling": "none"}),
        ({"scale": "quantile"}, {"scale": "quantile", "expert_share": None}),
        ({"scale_floor": 0.0}, {"scale_floor": 0.0}),
        ({"self_training": True}, {"self_training": True}),
        ({"labels": 60}, {"labeled": 60, "labeled_episodes": 1}),
    ],
)
def test_a_choice_replaces_that_of_the_preset(
    location: StoreLocation,
    capsys: pytest.CaptureFixture[str],
    choice: dict[str, Any],
    expected: dict[str, Any],
):
    score("drives", estimator="gpr", **choice, location=location, json=True)
    run = read_json(capsys)
    assert {name: run[name] for name in expected} == expected
    assert run["preset"] == ("default" if "labels" in choice else None)


def test_the_paper_with_another_scale_is_no_preset(
    location: StoreLocation, capsys: pytest.CaptureFixture[str]
):
    score("drives", estimator="gpr", preset="paper", scale="posterior", location=location)
    capsys.readouterr()
    show("drives", location=location, json=True)
    (run,) = read_json(capsys)["runs"]
    assert (run["preset"], run["scale"], run["pooling"]) == (None, "posterior", "none")


def test_a_share_that_is_known_is_taken_and_auto_is_the_default(
    location: StoreLocation, dataset: Dataset, capsys: pytest.CaptureFixture[str]
):
    for share in ("auto", None, "0.25"):
        score("drives", estimator="gpr", expert_share=share, location=location)
    auto, default, given = list(dataset.runs)
    assert auto.fitted_scale == default.fitted_scale
    assert given.scale == {"kind": "posterior", "expert_share": 0.25}
    assert given.preset is None


def test_show_has_what_every_run_says_of_itself_and_what_is_true(
    location: StoreLocation, dataset: Dataset, capsys: pytest.CaptureFixture[str]
):
    run = score_dataset(dataset, preset("default", "gpr"))
    old = score_dataset(dataset, Recipe(VAE(steps=20)), run="old")
    show("drives", location=location, json=True)
    shown, older = read_json(capsys)["runs"]
    assert set(shown) >= HEALTH
    assert shown["expert_share"] == run.expert_share
    assert shown["expert_share_interval"] == list(run.expert_share_interval or ())
    assert (older["expert_share"], older["weak"]) == (None, list(old.weak))
    leverage = dataset.leverage(run.name)
    expert = (dataset.per_pair("tier") == "expert") & ~dataset.per_pair("labeled").astype(bool)
    unlabeled = ~dataset.per_pair("labeled").astype(bool)
    assert shown["true_expert_share"] == pytest.approx(expert.sum() / unlabeled.sum())
    assert shown["true_weight_on_experts"] == pytest.approx(
        leverage[expert].sum() / leverage[unlabeled].sum(), rel=1e-5
    )
    assert 0 <= shown["true_calibration_error"] <= 1


def test_tables_fit_100_columns_and_say_what_is_weak_below(
    location: StoreLocation, dataset: Dataset, capsys: pytest.CaptureFixture[str]
):
    score_dataset(dataset, preset("default", "gpr"))
    score_dataset(dataset, preset("default", "gpr"), labels=2, run="two-labels")
    show("drives", location=location)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    weak = [line for line in lines if line.startswith("Weak: two-labels: ")]
    assert "Weak: two-labels: 2 labeled pairs: too few to know the expert by" in weak
    (row,) = [line for line in lines if "two-labels" in line and "window" in line]
    assert row.strip("│").split("│")[-1].strip() == "weak"


def test_without_tiers_show_has_no_empty_column(store: Store, capsys: pytest.CaptureFixture[str]):
    plain = [drive(seed, 40, labeled=seed == 0, spread=1 + 9 * (seed > 2)) for seed in range(6)]
    dataset = store.create("plain", plain, state_names=STATE_NAMES, action_names=ACTION_NAMES)
    score_dataset(dataset, Recipe(GPR(surprisal=True)))
    show("plain", location=StoreLocation(store.folder.uri))
    out = capsys.readouterr().out
    rows = [line for line in out.splitlines() if line.startswith("│")]
    assert len(rows) == 2
    cells = [cell.strip() for row in rows for cell in row.strip("│").split("│")]
    assert all(cells)
    assert cells.count("–") == 0
    for absent in ("true", "Spearman", "expert\n", "laps"):
        assert absent not in out


def test_a_run_that_held_nothing_out_is_unchecked_where_others_have_their_auroc(
    location: StoreLocation, dataset: Dataset, capsys: pytest.CaptureFixture[str]
):
    score("drives", estimator="gpr", location=location)
    assert "Unchecked" not in capsys.readouterr().out
    score("drives", estimator="gpr", preset="paper", run="by-paper", location=location)
    assert "Unchecked: no labeled pairs were held out" in capsys.readouterr().out
    show("drives", location=location)
    *_, checked, unchecked = [
        line.strip("│").split("│")[-1].strip()
        for line in capsys.readouterr().out.splitlines()
        if line.startswith(("│ gpr", "│ by-paper"))
    ]
    assert checked == f"{dataset.runs['gpr'].held_out_auroc:.3f}"
    assert unchecked == "unchecked"


def test_the_share_lies_in_the_interval_as_both_are_shown():
    row = dict.fromkeys(("true_expert_share", "true_weight_on_experts", "true_calibration_error"))
    shown = _list_chances(
        {
            **row,
            "run": "a",
            "expert_share": 0.0949,
            "expert_share_interval": (0.0951 - 0.0002, 0.0951),
            "effective_pairs": 100.4,
            "weight_on_experts": 0.5,
            "calibration_error": None,
            "held_out_auroc": None,
        }
    )
    low, high = map(float, shown["90 %\ninterval"].split("–"))
    assert low <= float(_format(shown["expert\nshare"])) <= high


def test_the_paper_without_an_estimator_asks_for_one(location: StoreLocation, dataset: Dataset):
    message = r"preset paper: needs an estimator; name one of the paper's, \['vae', .*'gpr'\]"
    with pytest.raises(InvalidInputError, match=message):
        score("drives", preset="paper", location=location)
    with pytest.raises(InvalidInputError, match=message):
        preset("paper")
    assert not list(dataset.runs)


def test_a_weak_run_is_a_warning_and_no_error(
    location: StoreLocation, capsys: pytest.CaptureFixture[str]
):
    score("drives", estimator="gpr", labels=2, run="two", location=location)
    out = capsys.readouterr().out
    assert "Rests on 2 labeled pairs of 1 episode\n" in out
    assert "Weak: two: 2 labeled pairs: too few to know the expert by" in out
    score("drives", estimator="gpr", labels=2, location=location, json=True)
    assert any("too few" in reason for reason in read_json(capsys)["weak"])


def test_a_run_of_an_earlier_version_says_the_little_it_knows(dataset: Dataset):
    record = score_dataset(dataset, VAE(steps=20)).to_json()
    first = {name: record[name] for name in record if name not in HEALTH - {"scale", "labeled"}}
    old = Run.from_json(first)
    assert describe_health(old) == [
        "Rests on 120 labeled pairs",
        "Unchecked: no labeled pairs were held out; the preset default holds them out",
    ]
    assert list_health(old)["expert_share"] is None
    assert list_health(old)["weak"] == []


def test_every_pair_labeled_is_refused_unless_nothing_is_compared(
    store: Store, capsys: pytest.CaptureFixture[str]
):
    labeled = drives()[:2]
    dataset = store.create("all", labeled, state_names=STATE_NAMES, action_names=ACTION_NAMES)
    location = StoreLocation(store.folder.uri)
    with pytest.raises(InvalidInputError, match="every pair is labeled"):
        score("all", location=location)
    assert not list(dataset.runs)
    score("all", estimator="gpr", scale="conformal", location=location)
    assert np.isfinite(dataset.leverage("gpr")).all()
    assert "no pair is unlabeled" in capsys.readouterr().out


def test_help_explains_every_choice(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    from ssil_data.cli import main

    with pytest.raises(SystemExit):
        main(["score", "--help"])
    out = capsys.readouterr().out
    for flag in ("--pool", "--expert-share", "--labels", "--no-self-training", "--scale-floor"):
        assert flag in out
