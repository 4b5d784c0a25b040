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
    """How well the policy's mean action did in a few episodes.

    Parameters
    ----------
    mean:
        Mean return of an episode; higher is better.
    least:
        The lowest return.
    length:
        Mean number of steps.
    score:
        Mean return over the expert's: 1 is as good as the expert. None if that is not known.
    """

    mean: float
    least: float
    length: float
    score: float | None


@dataclass(frozen=True)
class HistoryRow:
    """One row of the learning curve.

    Parameters
    ----------
    steps:
        Environment steps so far.
    iteration:
        The iteration; None before the first.
    evaluation:
        The evaluation after it; None where none was due.

    Examples
    --------
    >>> row = HistoryRow(0, None, Evaluation(mean=80.0, least=70.0, length=100.0, score=0.8))
    >>> row.figures()
    {'return_mean': 80.0, 'return_least': 70.0, 'return_length': 100.0, 'steps': 0, 'score': 0.8}
    """

    steps: int
    iteration: Iteration | None
    evaluation: Evaluation | None

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> HistoryRow:
        """Make the row that `dataclasses.asdict` turned into JSON.

        Parameters
        ----------
        row:
            The JSON of a row.
        """
        iteration = row["iteration"]
        evaluation = row["evaluation"]
        return cls(
            row["steps"],
            None if iteration is None else Iteration(**iteration),
            None if evaluation is None else Evaluation(**evaluation),
        )

    def figures(self) -> dict[str, Any]:
        """Return all figures by name, those of the evaluation's returns with a prefix."""
        figures = {} if self.iteration is None else asdict(self.iteration)
        evaluation = {} if self.evaluation is None else asdict(self.evaluation)
        figures |= {f"return_{key}": value for key, value in evaluation.items() if key != "score"}
        return {**figures, "steps": self.steps, "score": evaluation.get("score")}


def to_csv(curve: Sequence[HistoryRow]) -> str:
    """Return the rows as CSV with a header; what is not known is left empty.

    Parameters
    ----------
    curve:
        At least one row.

    Examples
    --------
    >>> print(to_csv([HistoryRow(0, None, Evaluation(-3.0, -4.0, 20.0, None))]), end="")
    return_mean,return_least,return_length,steps,score
    -3.0,-4.0,20.0,0,
    """
    rows = [row.figures() for row in curve]
    # Later rows have an iteration, and so the most columns in their order.
    names = list(dict.fromkeys(name for row in reversed(rows) for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, names, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
