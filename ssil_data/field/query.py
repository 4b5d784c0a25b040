"""The options of an LCoR query: how exact the values must be, and what else is returned.

Their one home: the keyword arguments of `lcor`, locally and over REST, the query parameters of the
service and the flags of the command all are the fields of `LCoRQuery`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TypedDict

import numpy as np

from ssil_data.errors import InvalidInputError
from ssil_data.json_kinds import to_python_number


@dataclass(frozen=True)
class Accuracy:
    """How exact LCoR must be: exact, to a tolerance, or as exact as a time limit allows.

    Without a tolerance or seconds, all demonstration states are used and the values are exact.

    Parameters
    ----------
    tolerance:
        Use a random part of the pairs, large enough for 99.9 % half-widths of at most this.
    relative:
        Take the tolerance in standard deviations of LCoR over the demonstrations.
    seconds:
        Use as large a random part of the pairs as this time allows. Reading all pairs once before
        the first such query is not counted. Two calls hardly ever return the same values.
    seed:
        Equal seeds choose equal parts.

    Raises
    ------
    InvalidInputError
        For a tolerance or seconds that are not finite and positive, a negative seed, both a
        tolerance and seconds, or `relative` or `seed` where nothing is sampled.

    Examples
    --------
    >>> sd.Accuracy().exact
    True
    >>> sd.Accuracy(tolerance=0.01).exact
    False
    """

    tolerance: float | None = None
    relative: bool = False
    seconds: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        """Validate, and replace numbers of NumPy by Python's."""
        for field in fields(self):
            object.__setattr__(self, field.name, to_python_number(getattr(self, field.name)))
        for name in ("tolerance", "seconds"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InvalidInputError(f"{name}: expected a finite number > 0, found {value}")
        if self.tolerance is not None and self.seconds is not None:
            raise InvalidInputError("accuracy: give a tolerance or seconds, not both")
        if self.relative and self.tolerance is None:
            raise InvalidInputError("relative: give the tolerance that it scales as well")
        if self.seed < 0:
            raise InvalidInputError(f"seed: expected at least 0, found {self.seed}")
        if self.seed and self.exact:
            raise InvalidInputError(
                "seed: only sampling uses it, which needs a tolerance or seconds as well"
            )

    @property
    def exact(self) -> bool:
        """Whether all demonstration states must be used."""
        return self.tolerance is None and self.seconds is None


@dataclass(frozen=True)
class LCoRQuery(Accuracy):
    """All options of an LCoR query: its accuracy, and how many contributors are named.

    Parameters
    ----------
    tolerance:
        Use a random part of the pairs, large enough for 99.9 % half-widths of at most this.
    relative:
        Take the tolerance in standard deviations of LCoR over the demonstrations.
    seconds:
        Use as large a random part of the pairs as this time allows.
    seed:
        Equal seeds choose equal parts.
    contributors:
        Return this many demonstration states that contributed most to each value; 0 for none.

    Raises
    ------
    InvalidInputError
        As `Accuracy`; also for a negative number of contributors, or for contributors of values
        that are not exact: only all demonstration states together can name them.

    Examples
    --------
    >>> from ssil_data.field import LCoRQuery
    >>> LCoRQuery(contributors=3).exact
    True
    """

    contributors: int = 0

    def __post_init__(self) -> None:
        """Validate."""
        super().__post_init__()
        check_contributors(self.contributors)
        if self.contributors and not self.exact:
            raise InvalidInputError(
                "contributors: expected 0 with a tolerance or seconds, as only all states "
                f"together can name them, found {self.contributors}"
            )


class LCoROptions(TypedDict, total=False):
    """The fields of `LCoRQuery` as keyword arguments, for type checkers; a test compares them."""

    tolerance: float | None
    relative: bool
    seconds: float | None
    seed: int
    contributors: int


def check_contributors(contributors: int) -> None:
    """Refuse a negative number of contributors.

    Parameters
    ----------
    contributors:
        How many are to be named.

    Raises
    ------
    InvalidInputError
        For a negative number.
    """
    if contributors < 0:
        raise InvalidInputError(f"contributors: expected at least 0, found {contributors}")
