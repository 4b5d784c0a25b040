"""A run's leverage field and its model, asked over REST."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from ssil_data.client.connection import Connection
from ssil_data.client.wire import ARROW, decode, encode, matrix_of_rows, pairs_table, states_table
from ssil_data.demonstrations import Pairs, finite_matrix
from ssil_data.errors import InvalidInputError
from ssil_data.field import Contributors, LCoR, LCoROptions, LCoRQuery
from ssil_data.kernels import Sums
from ssil_data.scoring import Scored
from ssil_data.store.arrow_schema import PARTS
from ssil_data.store.run_record import Run

_HEADERS = {"Content-Type": ARROW, "Accept": ARROW}
_ANSWERS = [field.name for field in fields(LCoR) if field.name != "contributors"]
_SUMS = [field.name for field in fields(Sums) if not field.name.startswith("nearest")]


@dataclass(frozen=True)
class RemoteField:
    """`LeverageField` over REST: the same questions and, on the same processor, the same bits."""

    connection: Connection
    path: str
    version: str
    width: int
    alpha: float
    most_rows: int
    """Rows that the service takes in one question; more are asked in several."""

    def lcor(
        self,
        states: ArrayLike,
        *,
        contributors: int = 0,
        tolerance: float | None = None,
        relative: bool = False,
        seconds: float | None = None,
        seed: int = 0,
    ) -> LCoR:
        """Return LCoR (equation 5) of states (m, d) in raw units, as `LeverageField.lcor` does."""
        options: dict[str, Any] = {"tolerance": tolerance, "seconds": seconds}
        if not Accuracy(tolerance, relative, seconds, seed).exact:
            options |= {"relative": str(relative).lower(), "seed": seed}
        table = self._query("lcor", states, contributors=contributors, **options)
        return LCoR(
            **{name: table[name].to_numpy() for name in _ANSWERS},
            contributors=Contributors(
                _lists(table, "contributor_row", np.int64),
                _lists(table, "contributor_share", np.float64),
            ),
        )

    def sums(self, states: ArrayLike, *, contributors: int = 0) -> Sums:
        """Return the sums of equation 5, which add up over the shards of a store."""
        table = self._query("lcor", states, contributors=contributors, sums="true")
        return Sums(
            **{name: table[name].to_numpy() for name in _SUMS},
            nearest=_lists(table, "nearest", np.int64),
            nearest_weight=_lists(table, "nearest_weight", np.float64),
        )

    def cor(self, states: ArrayLike) -> NDArray[np.float64]:
        """Return CoR (equation 2) of states (m, d) in raw units, (m,) in [0, 1]."""
        return self._query("cor", states)["value"].to_numpy()

    def _query(self, what: str, states: ArrayLike, **options: Any) -> pa.Table:
        if options.get("contributors", 0) < 0:
            found = options["contributors"]
            raise InvalidInputError(f"contributors: expected at least 0, found {found}")
        matrix = finite_matrix("states", states, width=self.width)
        params = {"version": self.version, "alpha": repr(self.alpha), **options}
        starts = range(0, max(1, len(matrix)), self.most_rows)
        parts = (states_table(matrix[i : i + self.most_rows]) for i in starts)
        url = f"{self.path}/{what}"
        return pa.concat_tables([_question(self.connection, url, part, params) for part in parts])


@dataclass(frozen=True)
class RemoteModel:
    """`LeverageModel` over REST: the leverage of pairs, seen before or not."""

    connection: Connection
    path: str
    run: Run
    most_rows: int

    def __call__(self, pairs: Pairs) -> Scored:
        """Score pairs; windows need the neighbouring rows of an episode in the same batch."""
        if len(pairs) > self.most_rows:
            raise InvalidInputError(
                f"pairs: expected at most {self.most_rows} at once, found {len(pairs)}"
            )
        table = _question(self.connection, f"{self.path}/score", pairs_table(pairs), {})
        parts = [name for name in PARTS if table[name].null_count == 0 and len(table)]
        return Scored(
            table["uncertainty"].to_numpy(),
            {name: table[name].to_numpy() for name in parts},
            table["leverage"].to_numpy(),
        )


def _question(
    connection: Connection, url: str, table: pa.Table, params: Mapping[str, Any]
) -> pa.Table:
    body = encode(table).to_pybytes()
    answer = connection.request(
        "POST", url, params=params, content=body, headers=_HEADERS, repeatable=True, work=True
    )
    return decode(answer.content)


def _lists(table: pa.Table, name: str, dtype: Any) -> NDArray[Any]:
    if name not in table.column_names:
        return np.empty((len(table), 0), dtype)
    return matrix_of_rows(table[name])
