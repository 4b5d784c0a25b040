"""The tables' facts, as the paper and the README state them."""

from __future__ import annotations

from typing import Any

import pytest

from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.experiments import charts, published
from ssil_trainers.experiments.tables import (
    FEW_LABELS,
    RACETRACK,
    RC_LIDAR,
    RC_LIDAR_TIGHT,
    TRAINING_TABLES,
    Table,
)

TRACKS = tuple(f"rc-lidar?track={name}" for name in ("attic", "cellar", "garage", "loft"))


@pytest.mark.parametrize(
    ("table", "labels", "budget", "pretrained", "full_score", "tests"),
    [
        (RACETRACK, (100, 300, 600, 1_200), 122_880, False, None, ("racetrack",)),
        (RC_LIDAR, (None,), 40_960, True, 400.0, TRACKS),
        (RC_LIDAR_TIGHT, (None,), 8_192, True, 400.0, TRACKS),
        (FEW_LABELS, (50, 100), 16_384, True, None, ("racetrack",)),
    ],
)
def test_a_table_is_trained_and_tested_as_it_is_described(
    table: Table,
    labels: tuple[int | None, ...],
    budget: int,
    pretrained: bool,
    full_score: float | None,
    tests: tuple[str, ...],
):
    assert table.labels == labels
    assert (table.full_score, table.tests, table.episodes) == (full_score, tests, 10)
    assert table.train_on not in TRACKS
    settings = table.settings(TrainSettings(), seed=7, budget=None)
    assert (settings.steps, settings.pretrained, settings.seed) == (budget, pretrained, 7)
    assert table.settings(TrainSettings(), seed=7, budget=5).steps == 5


def test_tables_have_the_papers_columns_in_its_order_and_then_the_controls():
    for table in (RACETRACK, RC_LIDAR):
        columns = [row.key for row in table.rows]
        for labels in table.labels:
            in_paper = [
                key for name, at, key in published.SCORES if (name, at) == (table.name, labels)
            ]
            assert columns[: len(in_paper)] == in_paper
        assert columns[-3:] == ["shuffled-windowvae", "constant", "clone"]


def test_what_imitates_by_leverage_stands_beside_the_same_with_equal_weights():
    methods = {row.method for row in FEW_LABELS.rows}
    for weighted, equal in (("gail-leverage", "gail-mixed"), ("clone-leverage", "clone-mixed")):
        assert {weighted, equal} <= methods


def test_every_row_is_a_method_and_has_an_estimator_if_it_asks_for_leverage():
    for table in TRAINING_TABLES:
        keys = [row.key for row in table.rows]
        assert len(set(keys)) == len(keys)
        for row in table.rows:
            assert (row.estimator is not None) == METHODS[row.method].requires_run


@pytest.mark.parametrize("table", TRAINING_TABLES, ids=lambda table: table.name)
def test_every_method_of_a_table_has_a_colour_of_its_own(table: Table) -> None:
    colour: Any = charts.method_color(table).to_dict()
    scale = colour["scale"]
    assert len(set(scale["range"])) == len(scale["domain"]) == len(table.rows)
    assert charts.OTHER_COLOR not in scale["range"]
