"""The tables against the paper's, and against the environments they name."""

from __future__ import annotations

from typing import Any

import pytest

from ssil_data.scoring.laps import count_laps
from ssil_data.store import Store
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.envs.rc_lidar.tracks import TEST_TRACKS, TRAINING_TRACK
from ssil_trainers.envs.registry import TASKS, find_spec
from ssil_trainers.experiments import charts, published
from ssil_trainers.experiments.tables import (
    COVERAGE,
    FEW_LABELS,
    RACETRACK,
    RC_LIDAR,
    RC_LIDAR_TIGHT,
    TRAINING_TABLES,
    Table,
)
from support.demonstrations import DATASETS


@pytest.mark.parametrize("table", TRAINING_TABLES, ids=lambda table: table.name)
def test_a_run_is_trained_with_the_tables_own_settings_and_the_given_others(table: Table) -> None:
    given = TrainSettings(kl=0.02, pretrained=not table.pretrained, evaluate_every=77)
    settings = table.settings(given, seed=7, budget=None)
    assert settings.steps == table.budget
    assert settings.pretrained == table.pretrained
    assert settings.evaluate_every == table.evaluate_every
    assert (settings.seed, settings.kl) == (7, 0.02)
    assert table.settings(given, seed=7, budget=5).steps == 5


@pytest.mark.parametrize(
    ("table", "labels", "budget", "pretrained", "full_score"),
    [
        (RACETRACK, (100, 300, 600, 1_200), 122_880, False, None),
        (RC_LIDAR, (None,), 40_960, True, 400.0),
        (RC_LIDAR_TIGHT, (None,), 8_192, True, 400.0),
        (FEW_LABELS, (50, 100), 16_384, True, None),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_a_table_is_trained_as_the_published_page_says(
    table: Table,
    labels: tuple[int | None, ...],
    budget: int,
    pretrained: bool,
    full_score: float | None,
) -> None:
    assert table.labels == labels
    assert (table.budget, table.pretrained) == (budget, pretrained)
    assert (table.full_score, table.episodes) == (full_score, 10)


def test_the_racetrack_has_the_papers_numbers_of_labels() -> None:
    in_paper = {labels for name, labels, _ in published.SCORES if name == RACETRACK.name}
    assert set(RACETRACK.labels) == in_paper


def test_coverage_is_table_i_with_the_papers_shares_of_a_lap() -> None:
    assert COVERAGE not in TRAINING_TABLES
    assert (COVERAGE.rows, COVERAGE.budget) == (RACETRACK.rows, RACETRACK.budget)
    demonstrations = Store(DATASETS)["racetrack"]
    labeled = demonstrations.per_pair("labeled").astype(bool)
    positions = demonstrations.read_recorded("position")
    laps = count_laps(positions, demonstrations.pairs().episode, labeled)
    assert laps == pytest.approx(6.32, abs=0.1)
    assert laps is not None
    pairs_of_a_lap = 1_200 / laps
    for here, there in zip(COVERAGE.labels, RACETRACK.labels, strict=True):
        assert here / pairs_of_a_lap == pytest.approx(there / 2_400, abs=0.01)
        in_paper = published.SCORES["racetrack", there, "ssil-vae"]
        assert published.SCORES["coverage", here, "ssil-vae"] == in_paper


@pytest.mark.parametrize("table", [RC_LIDAR, RC_LIDAR_TIGHT], ids=lambda table: table.name)
def test_rc_policies_are_tested_on_tracks_that_they_were_not_trained_on(table: Table) -> None:
    trained_on = track_of(table.train_on)
    tested_on = {track_of(task) for task in table.tests}
    assert tested_on == set(TEST_TRACKS)
    assert trained_on not in tested_on


def track_of(task: str) -> str:
    """The name of the track that an RC task is driven on."""
    spec = find_spec(task)
    assert spec.id == TASKS["rc-lidar"]
    return spec.kwargs.get("track", TRAINING_TRACK)


def test_tables_have_the_papers_columns_in_its_order_and_then_the_controls():
    for table in (RACETRACK, RC_LIDAR):
        columns = [row.key for row in table.rows]
        for labels in table.labels:
            in_paper = [
                key for name, at, key in published.SCORES if (name, at) == (table.name, labels)
            ]
            assert columns[: len(in_paper)] == in_paper
        assert columns[-3:] == ["shuffled-windowvae", "constant", "clone"]


def test_each_method_by_leverage_has_a_control_with_equal_weights():
    methods = {row.method for row in FEW_LABELS.rows}
    for weighted, equal in (("gail-leverage", "gail-mixed"), ("clone-leverage", "clone-mixed")):
        assert {weighted, equal} <= methods


def test_every_row_is_a_method_and_has_an_estimator_if_it_needs_leverage():
    for table in TRAINING_TABLES:
        keys = [row.key for row in table.rows]
        assert len(set(keys)) == len(keys)
        for row in table.rows:
            assert (row.estimator is not None) == METHODS[row.method].requires_run


@pytest.mark.parametrize("table", TRAINING_TABLES, ids=lambda table: table.name)
def test_every_method_of_a_table_has_its_own_color(table: Table) -> None:
    color: Any = charts.method_color(table).to_dict()
    scale = color["scale"]
    assert len(set(scale["range"])) == len(scale["domain"]) == len(table.rows)
    assert charts.OTHER_COLOR not in scale["range"]
