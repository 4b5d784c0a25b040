"""The learning curve of a run: a row for each iteration, with an evaluation where one was due."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ssil_trainers.algorithms.learner import Iteration


@dataclass(frozen=True)
class Evaluation:
    """How the mean action did: mean and least return of an episode, mean length, and the score.

    The score is the mean return over the expert's, None where the expert's is not known.
    """

    mean: float
    least: float
    length: float
    score: float | None


@dataclass(frozen=True)
class HistoryRow:
    """One row: steps so far, the iteration, None before the first, and the evaluation if any."""

    steps: int
    iteration: Iteration | None
    evaluation: Evaluation | None

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> HistoryRow:
        """Undo `asdict`."""
        iteration, evaluation = row["iteration"], row["evaluation"]
        return cls(
            row["steps"],
            None if iteration is None else Iteration(**iteration),
            None if evaluation is None else Evaluation(**evaluation),
        )

    def row(self) -> dict[str, Any]:
        """Return the figures by name, those of returns with their prefix."""
        figures = {} if self.iteration is None else asdict(self.iteration)
        scored = {} if self.evaluation is None else asdict(self.evaluation)
        figures |= {f"return_{key}": value for key, value in scored.items() if key != "score"}
        return {**figures, "steps": self.steps, "score": scored.get("score")}


def to_csv(curve: Sequence[HistoryRow]) -> str:
    """Return the rows as CSV; what is not known is empty."""
    rows = [moment.row() for moment in curve]
    names = list(dict.fromkeys(name for row in reversed(rows) for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, names, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
