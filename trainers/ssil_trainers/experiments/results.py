"""Finished cells put together: numbers for the ledger, rows for tables and files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_trainers.experiments import paper
from ssil_trainers.experiments.ledger import Claim, Numbers
from ssil_trainers.experiments.protocol import (
    ESTIMATORS,
    LEVERAGE,
    LEVERAGE_PRESETS,
    Row,
    Table,
)
from ssil_trainers.experiments.statistics import (
    Curve,
    Summary,
    deviation,
    interquartile_mean,
    interval,
)

Record = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Results:
    """The results of cells, as their files have them, in any order and number."""

    records: Sequence[Mapping[str, Any]]

    @cached_property
    def _groups(self) -> dict[tuple[Any, ...], list[Mapping[str, Any]]]:
        groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
        for record in sorted(self.records, key=lambda record: record["identity"]["cell"]["seed"]):
            cell = record["identity"]["cell"]
            key = cell["table"], cell["labels"], cell["method"], cell["estimator"]
            groups.setdefault(key, []).append(record)
        return groups

    def of(self, table: Table, row: Row, labels: int | None) -> list[Mapping[str, Any]]:
        """Return the results of a row, seed after seed; one without labels stands for them all."""
        key = table.name, labels if row.labeled else None, row.method, row.estimator
        return self._groups.get(key, [])

    def budget(self, table: Table) -> int:
        """Return the environment steps of the table's longest run."""
        found = [r for r in self.records if r["identity"]["cell"]["table"] == table.name]
        return max((record["curve"][-1]["steps"] for record in found), default=0)

    def full_score(self, table: Table) -> float | None:
        """Return the return that counts as 1; None if no cell of the table is there."""
        found = [r for r in self.records if r["identity"]["cell"]["table"] == table.name]
        return found[0]["full_score"] if found else None

    def scores(self, table: Table, row: Row, labels: int | None) -> NDArray[np.float64]:
        """Return the final scores (seeds,) on the real environment."""
        return np.array([record["score"] for record in self.of(table, row, labels)])

    def summary(self, table: Table, row: Row, labels: int | None) -> Summary | None:
        """Summarise a row; None if no seed is there."""
        found = self.of(table, row, labels)
        if not found:
            return None
        return Summary.of(self.scores(table, row, labels).tolist(), [curve(r) for r in found])

    def leverage(self, preset: str, estimator: str) -> list[Mapping[str, Any]]:
        """Return the results of scoring runs, seed after seed."""
        return self._groups.get((LEVERAGE, None, preset, estimator), [])

    def tiers(self, preset: str, estimator: str) -> NDArray[np.float64]:
        """Return the mean leverage (seeds, tiers), worst tier first; empty if none is there."""
        found = self.leverage(preset, estimator)
        return np.array([list(record["mean_leverage_by_tier"].values()) for record in found])

    def numbers(self, tables: Iterable[Table]) -> Numbers:
        """Return what the ledger judges by."""
        scores = {
            (table.name, labels, row.key): self.scores(table, row, labels)
            for table in tables
            for row in table.rows
            for labels in table.labels
        }
        return Numbers(scores, {kind: self.tiers("paper", kind) for kind in ESTIMATORS})

    def rows(self, table: Table) -> list[Record]:
        """Return the table as rows, one for every method and number of labels that has results."""
        made = []
        for labels in table.labels:
            for row in table.rows:
                summary = self.summary(table, row, labels)
                if summary is not None:
                    mean, off = paper.SCORES.get((table.name, labels, row.key), (None, None))
                    learned = [
                        record["curve"][-1]["score"] for record in self.of(table, row, labels)
                    ]
                    made.append(
                        {
                            "labels": labels,
                            "method": row.key,
                            "title": row.title,
                            **asdict(summary),
                            "where_trained": float(np.mean(learned)),
                            "paper_mean": mean,
                            "paper_deviation": off,
                        }
                    )
        return made

    def over_labels(self, table: Table) -> list[Record]:
        """Return each method's interquartile mean over all labels, with its stratified interval."""
        made = []
        for row in table.rows:
            counted = table.labels if row.labeled else table.labels[:1]
            strata = [self.scores(table, row, labels) for labels in counted]
            if all(len(stratum) for stratum in strata):
                low, high = interval(strata)
                middle = interquartile_mean(np.concatenate(strata))
                made.append({"key": row.key, "mean": middle, "low": low, "high": high})
        return made

    def leverage_rows(self) -> list[Record]:
        """Return the table of leverage by tier, beside the paper's."""
        made = []
        for preset in LEVERAGE_PRESETS:
            for kind in ESTIMATORS:
                tiers, found = self.tiers(preset, kind), self.leverage(preset, kind)
                if not found:
                    continue
                names = list(found[0]["mean_leverage_by_tier"])
                published = paper.LEVERAGE.get(kind) if preset == "paper" else None
                made.append(
                    {
                        "preset": preset,
                        "estimator": kind,
                        "seeds": len(found),
                        "tiers": dict(zip(names, tiers.mean(axis=0).tolist(), strict=True)),
                        "deviations": [deviation(column) for column in tiers.T],
                        "auroc": _mean(found, "auroc"),
                        "spearman": _mean(found, "spearman"),
                        "paper": None if published is None else list(published),
                    }
                )
        return made

    def judge(self, claims: Iterable[Claim], numbers: Numbers) -> list[Record]:
        """Return each claim with its verdict and the numbers it was judged by."""
        made = []
        for claim in claims:
            found = claim.rule(numbers)
            made.append(
                {
                    "where": claim.where,
                    "statement": claim.statement,
                    "verdict": found.verdict.value,
                    "by": found.by,
                    "note": claim.note,
                }
            )
        return made


def curve(record: Mapping[str, Any]) -> Curve:
    """Return a cell's learning curve, as measured where it trained."""
    rows = record["curve"]
    return Curve(tuple(row["steps"] for row in rows), tuple(row["score"] for row in rows))


def _mean(records: Sequence[Mapping[str, Any]], name: str) -> float | None:
    values = [record[name] for record in records]
    return None if None in values else float(np.mean(values))
