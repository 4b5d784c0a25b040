"""What the compiled code adds up over pairs of a query and a reference."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import Any

from ssil_data.kernels.instructions import fmuladd


class Products(Enum):
    """Which products of weight w, relative distance u = t − 1 and leverage l are added up.

    SUMS: l w, w, w², all that LCoR needs. MOMENTS: u, u², w, w u, w², each times 1, l and l², all
    that a regression of w and l w on 1, l, u and l u needs. The value is how many sums that is.
    """

    SUMS = 3
    MOMENTS = 15

    @property
    def count(self) -> int:
        """Number of sums of a query."""
        return self.value

    def add(self, b: Any, totals: Sequence, *, u: Any, w: Any, leverage: Any) -> Sequence:
        """Write totals + products.

        Parameters
        ----------
        b
            Builder.
        totals
            `count` vectors.
        u, w, leverage
            Vectors of the pairs' relative distance, weight and leverage.

        Returns
        -------
        Sequence
            The new totals.
        """
        if self is Products.SUMS:
            numerator, denominator, squares = totals
            return [
                fmuladd(b, leverage, w, numerator),
                b.fadd(denominator, w),
                fmuladd(b, w, w, squares),
            ]
        square = b.fmul(leverage, leverage)
        added = []
        for kind, value in enumerate((u, b.fmul(u, u), w, b.fmul(w, u), b.fmul(w, w))):
            plain, once, twice = totals[3 * kind : 3 * kind + 3]
            added += [
                b.fadd(plain, value),
                fmuladd(b, value, leverage, once),
                fmuladd(b, value, square, twice),
            ]
        return added
