"""A run's leverage field and its model over REST."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Unpack

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from ssil_data.client.connection import Connection
from ssil_data.client.wire import ARROW, decode, encode, matrix_of_rows, pairs_table, states_table
from ssil_data.demonstrations import Pairs, finite_matrix
from ssil_data.errors import InvalidInputError
from ssil_data.field import Contributors, LCoR, LCoROptions, LCoRQuery
from ssil_data.field.query import check_contributors
from ssil_data.kernels import Sums, check_alpha
from ssil_data.scoring import Scored
from ssil_data.store.arrow_schema import PARTS
from ssil_data.store.run_record import Run

_HEADERS = {"Content-Type": ARROW, "Accept": ARROW}
_LCOR_COLUMNS = [field.name for field in fields(LCoR) if field.name != "contributors"]
_SUMS_COLUMNS = [field.name for field in fields(Sums) if not field.name.startswith("nearest")]


@dataclass(frozen=True)
class RemoteField:
    """`LeverageField` over REST: the same methods and, on the same processor, the same bits.

    Parameters
    ----------
    connection
        To the service.
    path
        Of the run at the service.
    version
        The dataset's version whose states it is over.
    width
        d, the number of state dimensions.
    alpha
        The kernel's sharpness.
    most_rows
        States that the service takes in one request; more are sent in several.

    Examples
    --------
    >>> field = remote["drives"].field("vae")
    >>> states = remote["drives"].episode(3).states
    >>> bool((field.lcor(states).values == dataset.field("vae").lcor(states).values).all())
    True
    """

    connection: Connection
    path: str
    version: str
    width: int
    alpha: float
    most_rows: int

    def at(self, alpha: float) -> RemoteField:
        """Return the field with another sharpness, as `LeverageField.at` does.

        Parameters
        ----------
        alpha
            The kernel's sharpness, > 0.

        Raises
        ------
        InvalidInputError
            For an alpha at which the kernel cannot be computed.
        """
        return replace(self, alpha=check_alpha(alpha))

    def lcor(self, states: ArrayLike, **options: Unpack[LCoROptions]) -> LCoR:
        """Return LCoR of states, as `LeverageField.lcor` does.

        Parameters
        ----------
        states
            (m, d) in raw units.
        options
            The fields of `LCoRQuery` as keyword arguments. `seconds` are those of the service, for
            each request.

        Returns
        -------
        LCoR
            Values (m,), their effective sample sizes, half-widths and contributors.

        Raises
        ------
        InvalidInputError
            For states of another width or not finite, and for options that conflict or that the
            service does not take.
        ServiceError
            If the service does not answer.
        """
        query = LCoRQuery(**options)
        given = {
            each.name: getattr(query, each.name)
            for each in fields(query)
            if getattr(query, each.name) != each.default
        }
        table = self._query("lcor", states, given)
        return LCoR(
            **{name: table[name].to_numpy() for name in _LCOR_COLUMNS},
            contributors=Contributors(
                _lists(table, "contributor_row", np.int64),
                _lists(table, "contributor_share", np.float64),
            ),
        )

    def sums(self, states: ArrayLike, *, contributors: int = 0) -> Sums:
        """Return the sums that make LCoR, as `LeverageField.sums` does.

        Parameters
        ----------
        states
            (m, d) in raw units.
        contributors
            Also return this many demonstration states that weigh most.

        Raises
        ------
        InvalidInputError
            For states of another width or not finite, and for a negative number.
        ServiceError
            If the service does not answer.
        """
        check_contributors(contributors)
        table = self._query("lcor", states, {"contributors": contributors, "sums": True})
        return Sums(
            **{name: table[name].to_numpy() for name in _SUMS_COLUMNS},
            nearest=_lists(table, "nearest", np.int64),
            nearest_weight=_lists(table, "nearest_weight", np.float64),
        )

    def cor(self, states: ArrayLike) -> NDArray[np.float64]:
        """Return CoR of states (m, d) in raw units, (m,) in [0, 1], as `LeverageField.cor` does.

        Parameters
        ----------
        states
            (m, d) in raw units.

        Raises
        ------
        InvalidInputError
            For states of another width or not finite, and where all states are labeled, or none.
        ServiceError
            If the service does not answer.
        """
        return self._query("cor", states, {})["value"].to_numpy()

    def _query(self, what: str, states: ArrayLike, options: Mapping[str, Any]) -> pa.Table:
        """Return the answer for all states, in as many requests as the service's limit needs."""
        matrix = finite_matrix("states", states, width=self.width)
        params = {"version": self.version, "alpha": repr(self.alpha), **options}
        starts = range(0, max(1, len(matrix)), self.most_rows)
        parts = (states_table(matrix[i : i + self.most_rows]) for i in starts)
        url = f"{self.path}/{what}"
        return pa.concat_tables([_post(self.connection, url, part, params) for part in parts])


@dataclass(frozen=True)
class RemoteModel:
    """`LeverageModel` over REST: the leverage of pairs, of the dataset or new ones.

    Parameters
    ----------
    connection
        To the service.
    path
        Of the run at the service.
    run
        The run's record.
    most_rows
        Pairs that the service takes in one request.

    Examples
    --------
    >>> pairs = remote["drives"].episode(3)
    >>> scored = remote["drives"].model("vae")(pairs)
    >>> scored.leverage.shape == (len(pairs),)
    True
    """

    connection: Connection
    path: str
    run: Run
    most_rows: int

    def __call__(self, pairs: Pairs) -> Scored:
        """Return uncertainty, pooled inside the episodes of this call, and leverage of pairs.

        Parameters
        ----------
        pairs
            In raw units; estimators of windows and poolings need the neighboring rows of an episode
            in the same call. A pair that comes alone is judged alone.

        Raises
        ------
        InvalidInputError
            For pairs of other widths, or more than the service takes in one request.
        ServiceError
            If the service does not answer.
        """
        if len(pairs) > self.most_rows:
            raise InvalidInputError(
                f"pairs: expected at most {self.most_rows} at once, found {len(pairs)}"
            )
        table = _post(self.connection, f"{self.path}/score", pairs_table(pairs), {})
        known = [name for name in table.column_names if len(table) and not table[name].null_count]
        columns = {name: table[name] for name in known}
        uncertainty = table["uncertainty"].to_numpy()
        return Scored(
            uncertainty=uncertainty,
            parts={name: columns[name].to_numpy() for name in PARTS if name in columns},
            leverage=table["leverage"].to_numpy(),
            # a service of 0.1 pools nothing
            pooled=columns["pooled"].to_numpy() if "pooled" in columns else uncertainty,
        )


def _post(connection: Connection, url: str, table: pa.Table, params: Mapping[str, Any]) -> pa.Table:
    """Send a table and return the table that answers it."""
    body = encode(table).to_pybytes()
    answer = connection.request(
        "POST", url, params=params, content=body, headers=_HEADERS, repeatable=True, work=True
    )
    return decode(answer.content)


def _lists(table: pa.Table, name: str, dtype: Any) -> NDArray[Any]:
    """Return a column of lists as a matrix; without the column, one of no columns."""
    if name not in table.column_names:
        return np.empty((len(table), 0), dtype)
    return matrix_of_rows(table[name])
