"""Which cells a plan has, and that each is trained, scored and labeled as its name says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from ssil_data.scoring import preset
from ssil_data.store import Store
from ssil_trainers.experiments.cells import Training
from ssil_trainers.experiments.fits import Fit
from ssil_trainers.experiments.plan import Plan
from ssil_trainers.experiments.tables import Row


@pytest.fixture
def plan(tmp_path: Path, swings_plan: Callable[[Path], Plan]) -> Plan:
    """A plan of two seeds and two estimators."""
    made = swings_plan(tmp_path)
    (table,) = made.tables
    rows = (
        *table.rows,
        Row("ssil", "SSIL (windowVAE)", "windowvae"),
        Row("mixgail", "MixGAIL"),
    )
    estimators = ("vae", "windowvae")
    return replace(made, tables=(replace(table, rows=rows),), seeds=(3, 4), estimators=estimators)


def trainings(plan: Plan) -> list[Training]:
    found = [task for task in plan.tasks if isinstance(task, Training)]
    assert found
    return found


def fit_of(task: Training) -> Fit:
    assert task.fit is not None
    return task.fit


def test_there_is_a_cell_for_every_seed_row_and_number_of_labels(plan: Plan):
    names = [task.name for task in plan.tasks]
    assert len(set(names)) == len(names)
    for_labels = 5 * 2
    once = 1
    scorings = 2 * 2
    assert len(names) == 2 * (for_labels + once + scorings)


def test_every_cell_is_trained_by_its_own_seed(plan: Plan):
    assert {task.cell.seed for task in plan.tasks} == {3, 4}
    for task in trainings(plan):
        assert task.settings.seed == task.cell.seed
        assert task.identity["training"]["seed"] == task.cell.seed


def test_every_leverage_is_fitted_by_its_cells_seed_estimator_and_preset(plan: Plan):
    for chosen in ("default", "paper"):
        for task in trainings(replace(plan, preset=chosen)):
            if task.cell.method == "ssil":
                fit = fit_of(task)
                assert (fit.seed, fit.preset) == (task.cell.seed, chosen)
                assert fit.estimator == task.cell.estimator
                assert task.identity["scoring"]["recipe"] == str(preset(chosen, fit.estimator))
    for task in plan.tasks:
        if task.cell.table == "leverage":
            assert task.fit is not None
            found = (task.fit.estimator, task.fit.preset, task.fit.seed)
            assert found == (task.cell.estimator, task.cell.method, task.cell.seed)


def test_scoring_runs_of_different_seeds_estimators_or_labels_are_different(plan: Plan):
    fits = [fit_of(task) for task in trainings(plan) if task.cell.method == "ssil"]
    assert len({(fit.dataset, fit.run) for fit in fits}) == len(fits) == 2 * 2 * 2


def test_every_cell_has_as_many_labels_as_it_says(plan: Plan):
    for task in trainings(plan):
        found = int(Store(task.store)[task.dataset].per_pair("labeled").sum())
        assert found == (80 if task.cell.labels is None else task.cell.labels)
        if task.fit is not None:
            assert task.fit.dataset == task.dataset


def test_methods_without_leverage_have_no_scoring_run(plan: Plan):
    """Not even MixGAIL, whose kernel has a sharpness of its own."""
    for task in trainings(plan):
        assert (task.fit is None) == (task.cell.method != "ssil")


def test_a_budget_is_that_of_every_training_run(plan: Plan):
    assert {task.settings.steps for task in trainings(plan)} == {64}
    assert {task.settings.steps for task in trainings(replace(plan, budget=96))} == {96}
