"""The results of finished cells: scores to judge claims by, and rows for tables and files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_trainers.experiments import published
from ssil_trainers.experiments.statistics import (
    Curve,
    Summary,
    deviation,
    interquartile_mean,
    interval,
)
from ssil_trainers.experiments.tables import (
    ESTIMATORS,
    LEVERAGE,
    LEVERAGE_PRESETS,
    Row,
    Table,
)
from ssil_trainers.experiments.verdicts import Claim, Numbers

Record = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Results:
    """The results of cells, in any order and number.

    Parameters
    ----------
    records:
        Contents of the cells' files.
    """

    records: Sequence[Mapping[str, Any]]

    @cached_property
    def _groups(self) -> dict[tuple[Any, ...], list[Mapping[str, Any]]]:
        groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
        for record in sorted(self.records, key=lambda record: record["identity"]["cell"]["seed"]):
            cell = record["identity"]["cell"]
            key = cell["table"], cell["labels"], cell["method"], cell["estimator"]
            groups.setdefault(key, []).append(record)
        return groups

    def records_of(self, table: Table, row: Row, labels: int | None) -> list[Mapping[str, Any]]:
        """Return the results of a row, seed by seed; a row without labels has the same for all.

        Parameters
        ----------
        table:
            The table.
        row:
            Its row.
        labels:
            Number of labels; None is all.
        """
        key = table.name, labels if row.labeled else None, row.method, row.estimator
        return self._groups.get(key, [])

    def budget(self, table: Table) -> int:
        """Return the environment steps of the table's longest run; 0 without results.

        Parameters
        ----------
        table:
            The table.
        """
        found = [r for r in self.records if r["identity"]["cell"]["table"] == table.name]
        return max((record["curve"][-1]["steps"] for record in found), default=0)

    def full_score(self, table: Table) -> float | None:
        """Return the return that counts as a score of 1; None without results.

        Parameters
        ----------
        table:
            The table.
        """
        found = [r for r in self.records if r["identity"]["cell"]["table"] == table.name]
        return found[0]["full_score"] if found else None

    def recorded_return(self, table: Table) -> float | None:
        """Return the expert's return as recorded, with noise on its actions; None if not known.

        Parameters
        ----------
        table:
            The table.
        """
        found = [r for r in self.records if r["identity"]["cell"]["table"] == table.name]
        return found[0].get("recorded_return") if found else None

    def laps(self, table: Table, labels: int | None) -> float | None:
        """Return how many laps so many labeled pairs cover; None if that is not known.

        Parameters
        ----------
        table:
            The table.
        labels:
            Number of labels; None is all.
        """
        for row in table.rows:
            for record in self.records_of(table, row, labels) if row.labeled else ():
                return record.get("laps")
        return None

    def scores(self, table: Table, row: Row, labels: int | None) -> NDArray[np.float64]:
        """Return the final scores (seeds,) in the real environment; higher is better.

        Parameters
        ----------
        table:
            The table.
        row:
            Its row.
        labels:
            Number of labels; None is all.
        """
        return np.array([record["score"] for record in self.records_of(table, row, labels)])

    def summary(self, table: Table, row: Row, labels: int | None) -> Summary | None:
        """Summarize a row; None without results.

        Parameters
        ----------
        table:
            The table.
        row:
            Its row.
        labels:
            Number of labels; None is all.
        """
        found = self.records_of(table, row, labels)
        if not found:
            return None
        return Summary.of(
            self.scores(table, row, labels).tolist(), [learning_curve(r) for r in found]
        )

    def leverage(self, preset: str, estimator: str) -> list[Mapping[str, Any]]:
        """Return the results of scoring runs, seed by seed.

        Parameters
        ----------
        preset:
            Name of the preset.
        estimator:
            Name of the estimator.
        """
        return self._groups.get((LEVERAGE, None, preset, estimator), [])

    def tiers(self, preset: str, estimator: str) -> NDArray[np.float64]:
        """Return the mean leverage (seeds, tiers), worst tier first; empty without results.

        Parameters
        ----------
        preset:
            Name of the preset.
        estimator:
            Name of the estimator.
        """
        found = self.leverage(preset, estimator)
        return np.array([list(record["mean_leverage_by_tier"].values()) for record in found])

    def numbers(self, tables: Iterable[Table]) -> Numbers:
        """Return the numbers that claims about these tables are judged by.

        Parameters
        ----------
        tables:
            The tables.
        """
        scores = {
            (table.name, labels, row.key): self.scores(table, row, labels)
            for table in tables
            for row in table.rows
            for labels in table.labels
        }
        return Numbers(scores, {kind: self.tiers("paper", kind) for kind in ESTIMATORS})

    def rows(self, table: Table) -> list[Record]:
        """Return the table as rows, one for each method and number of labels with results.

        Parameters
        ----------
        table:
            The table.
        """
        rows = [self._row(table, row, labels) for labels in table.labels for row in table.rows]
        return [row for row in rows if row is not None]

    def _row(self, table: Table, row: Row, labels: int | None) -> Record | None:
        """Return one row of a table beside the paper's numbers; None without results."""
        summary = self.summary(table, row, labels)
        if summary is None:
            return None
        paper_mean, paper_deviation = published.SCORES.get(
            (table.name, labels, row.key), (None, None)
        )
        curves = [learning_curve(record) for record in self.records_of(table, row, labels)]
        most = [max(curve.scores) for curve in curves]
        return {
            "labels": labels,
            "laps": self.laps(table, labels),
            "method": row.key,
            "title": row.title,
            **asdict(summary),
            "where_trained": float(np.mean([curve.scores[-1] for curve in curves])),
            "most_where_trained": float(np.mean(most)),
            "most_deviation": deviation(most),
            "paper_mean": paper_mean,
            "paper_deviation": paper_deviation,
        }

    def over_labels(self, table: Table) -> list[Record]:
        """Return each method's interquartile mean over all labels, with its stratified interval.

        Parameters
        ----------
        table:
            The table.
        """
        made = []
        for row in table.rows:
            numbers = table.labels if row.labeled else table.labels[:1]
            strata = [self.scores(table, row, labels) for labels in numbers]
            if all(len(stratum) for stratum in strata):
                low, high = interval(strata)
                middle = interquartile_mean(np.concatenate(strata))
                made.append({"key": row.key, "mean": middle, "low": low, "high": high})
        return made

    def leverage_rows(self) -> list[Record]:
        """Return the table of leverage by tier, beside the paper's."""
        return [
            self._leverage_row(preset, estimator)
            for preset in LEVERAGE_PRESETS
            for estimator in ESTIMATORS
            if self.leverage(preset, estimator)
        ]

    def _leverage_row(self, preset: str, estimator: str) -> Record:
        """Return one row of the table of leverage."""
        records = self.leverage(preset, estimator)
        tiers = self.tiers(preset, estimator)
        names = list(records[0]["mean_leverage_by_tier"])
        paper = published.LEVERAGE.get(estimator) if preset == "paper" else None
        return {
            "preset": preset,
            "estimator": estimator,
            "seeds": len(records),
            "tiers": dict(zip(names, tiers.mean(axis=0).tolist(), strict=True)),
            "deviations": [deviation(column) for column in tiers.T],
            "auroc": _mean(records, "auroc"),
            "spearman": _mean(records, "spearman"),
            "paper": None if paper is None else list(paper),
        }

    def judge(self, claims: Iterable[Claim], numbers: Numbers) -> list[Record]:
        """Return each claim with its verdict and the numbers behind it.

        Parameters
        ----------
        claims:
            The claims.
        numbers:
            What was measured.
        """
        made = []
        for claim in claims:
            judgment = claim.rule(numbers)
            made.append(
                {
                    "where": claim.where,
                    "statement": claim.statement,
                    "verdict": judgment.verdict.value,
                    "by": judgment.by,
                    "note": claim.note,
                }
            )
        return made


def learning_curve(record: Mapping[str, Any]) -> Curve:
    """Return a cell's learning curve, measured where it was trained.

    Parameters
    ----------
    record:
        Content of the cell's file.
    """
    rows = record["curve"]
    return Curve(tuple(row["steps"] for row in rows), tuple(row["score"] for row in rows))


def _mean(records: Sequence[Mapping[str, Any]], name: str) -> float | None:
    """Return the mean of a number over records; None if one has none."""
    values = [record[name] for record in records]
    return None if None in values else float(np.mean(values))
