"""The command `ssil-data reproduce`: the paper's tables, cell by cell, and one page about them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ssil_data.commands.output import AsJson, StoreLocation, StoreOption, print_json, print_table
from ssil_data.errors import InvalidInputError
from ssil_data.store import Store
from ssil_trainers.algorithms.given_settings import (
    GivenSettings,
    PresetName,
    apply_preset,
    list_given,
    name_option,
)
from ssil_trainers.experiments.plan import Plan, find_missing_fits
from ssil_trainers.experiments.process_pool import Report, count_processors, open_pool, run_tasks
from ssil_trainers.experiments.publishing import publish
from ssil_trainers.experiments.results import Results
from ssil_trainers.experiments.tables import COVERAGE, LEVERAGE, TRAINING_TABLES, Table
from ssil_trainers.experiments.verdicts import FEWEST_SEEDS

WHOLE = Path("docs/reproduction")
"""Default folder of the whole reproduction."""
PARTIAL = Path("reproduction")
"""Default folder of a part of it."""
FRESH_SEED = 300
"""The first seed that no setting was chosen by, and whose results were not looked at before.

Seeds 0–2 tuned the defaults; 100–105 and 200–202 were looked at in between.
"""

_OF_TABLES = {
    "seed": "the seeds are those of --first-seed and --seeds",
    "steps": "every table has its own, or those of --budget",
    "pretrained": "every table has its own",
    "evaluate_every": "every table has its own",
}
"""Settings of training that are not the caller's, and where they come from."""


def _check_least(name: str, number: int | None, least: int) -> None:
    """Raise InvalidInputError for a number below its minimum; None is fine."""
    if number is not None and number < least:
        raise InvalidInputError(f"{name}: expected at least {least}, found {number}")


@dataclass(frozen=True)
class ReproductionSettings:
    """Which part of the paper's tables to run, and how.

    Parameters
    ----------
    table:
        racetrack is table I and few-labels, leverage table II, rc-lidar table III. coverage,
        which is not part of all, is table I with as little of a lap labeled as in the paper.
    seeds:
        Runs of every cell.
    first_seed:
        Seed of the first run; the next ones have the following seeds. Seeds 0 to 2 tuned the
        defaults, 100 to 105 and 200 to 202 were looked at on the way.
    budget:
        Environment steps of every training run. [default: 122,880 racetrack; 40,960,
        and 8,192, rc-lidar; 16,384 few-labels]
    preset:
        `paper` has the paper's leverage and loop, `default` what measured best.
    labels:
        Only these of the tables' numbers of labels.
    methods:
        Only these methods.
    training:
        Settings of training; steps, seed, pretrained and evaluate-every are the tables', and those
        that the preset has are the preset's: given another value, they are refused.

    Raises
    ------
    InvalidInputError
        For a number below its minimum, and for settings of training that would be replaced.

    Examples
    --------
    >>> ReproductionSettings(seeds=5).is_whole, ReproductionSettings(budget=4096).is_whole
    (True, False)
    """

    table: Literal["racetrack", "leverage", "rc-lidar", "few-labels", "coverage", "all"] = "all"
    seeds: int = 3
    first_seed: int = FRESH_SEED
    budget: int | None = None
    preset: PresetName = "default"
    labels: tuple[int, ...] = ()
    methods: tuple[str, ...] = ()
    training: GivenSettings = GivenSettings()  # noqa: RUF009  frozen

    def __post_init__(self) -> None:
        """Validate every number, and refuse settings of training that would be replaced."""
        _check_least("seeds", self.seeds, 1)
        _check_least("first-seed", self.first_seed, 0)
        _check_least("budget", self.budget, 1)
        for name in list_given(self.training):
            if name in _OF_TABLES:
                option = name_option(f"training.{name}", getattr(self.training, name))
                raise InvalidInputError(f"{option}: {_OF_TABLES[name]}; leave it out")
        apply_preset(self.preset, self.training, prefix="training.")

    @property
    def is_whole(self) -> bool:
        """Whether these are all tables, by the defaults, with enough seeds to judge claims."""
        defaults = ReproductionSettings(seeds=self.seeds, first_seed=self.first_seed)
        return self == defaults and self.seeds >= FEWEST_SEEDS

    def plan(self, source: Store, output: Path) -> Plan:
        """Make the plan of these settings.

        Parameters
        ----------
        source:
            The store of the demonstrations, which is only read.
        output:
            Folder of the results.
        """
        tables = [
            table for table in TRAINING_TABLES if self.table in (table.name, table.dataset, "all")
        ]
        if self.table == COVERAGE.name:
            tables = [COVERAGE]
        return Plan(
            tables=_narrow_tables(tables, self.labels, self.methods),
            leverage="racetrack" if self.table in (LEVERAGE, "all") else None,
            seeds=tuple(range(self.first_seed, self.first_seed + self.seeds)),
            preset=self.preset,
            training=apply_preset(self.preset, self.training),
            budget=self.budget,
            source=source,
            output=output,
            work=output / "work",
        )


def reproduce(
    *,
    settings: Annotated[ReproductionSettings, Parameter(name="*")] = ReproductionSettings(),
    workers: int | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    location: StoreOption = StoreLocation(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Run the paper's tables with controls; write tables, verdicts and one offline page.

    Every method is trained with the same settings. A finished cell is a file below `cells/` in the
    output folder; after an interruption the same command goes on from there. The store is only
    read: copies with fewer labels, and scoring runs, are made below `work/`.

    Parameters
    ----------
    workers:
        Processes of one thread each. [default: one for every core]
    output:
        Folder of the page, tables, settings and cells. [default: docs/reproduction for the whole
        run by its defaults, with 3 seeds or more; reproduction for anything else]
    """
    _check_least("workers", workers, 1)
    output = output or (WHOLE if settings.is_whole else PARTIAL)
    plan = settings.plan(location.open(), output)
    try:
        results = run_plan(plan, workers=workers or count_processors(), report=_print_to_stderr)
    except KeyboardInterrupt:
        print(f"Stopped. The same command goes on from the finished cells in {output / 'cells'}.")
        raise SystemExit(130) from None
    verdicts = publish(plan, results)
    if json:
        print_json({"cells": len(results.records), "verdicts": verdicts, "output": str(output)})
    else:
        print_table("Claims of the paper", [verdicts])
        print(f"Page: {output / 'index.html'}")


def run_plan(plan: Plan, *, workers: int, report: Report) -> Results:
    """Run the cells of a plan that are missing or outdated, and return the results of all.

    Parameters
    ----------
    plan:
        The plan.
    workers:
        Number of worker processes.
    report:
        Called with progress lines.
    """
    missing = [task for task in plan.tasks if task.read_result() is None]
    outdated = sum(task.path.exists() for task in missing)
    report(f"{len(plan.tasks) - len(missing)} of {len(plan.tasks)} cells are done already")
    if outdated:
        report(
            f"{outdated} others are of other settings, data, versions or code and are made again"
        )
    if missing:
        with open_pool(workers) as executor:
            run_tasks(executor, "scoring run", find_missing_fits(missing), report)
            run_tasks(executor, "cell", missing, report)
    found = [task.read_result() for task in plan.tasks]
    return Results([result for result in found if result is not None])


def _narrow_tables(
    tables: Sequence[Table], labels: tuple[int, ...], methods: tuple[str, ...]
) -> tuple[Table, ...]:
    """Keep only these labels and methods of the tables; drop tables that have none of them."""
    known_labels = {n for table in tables for n in table.labels if n is not None}
    known_methods = {row.method for table in tables for row in table.rows}
    for name, chosen, known in (
        ("labels", labels, known_labels),
        ("methods", methods, known_methods),
    ):
        if not set(chosen) <= known:
            raise InvalidInputError(f"{name}: expected some of {sorted(known)}, found {chosen}")
    narrowed = [
        replace(
            table,
            labels=tuple(n for n in table.labels if n is None or not labels or n in labels),
            rows=tuple(row for row in table.rows if not methods or row.method in methods),
        )
        for table in tables
    ]
    return tuple(table for table in narrowed if table.labels and table.rows)


def _print_to_stderr(line: str) -> None:
    """Print a progress line."""
    print(line, file=sys.stderr, flush=True)
