"""The posterior scale: leverage is the chance that a pair is the expert's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.json_kinds import check_fields, show_short, to_python_number
from ssil_data.ranks import interpolate
from ssil_data.scales.base import FittedScale, Scale, check_finite, check_numbers, read_numbers

TILT_OF_EXPERTS = 0.02
"""Sure experts differ by at most this, which is far below what a chance is known to."""
TILT_OF_OTHERS = 1e-4
"""Sure others differ by at most this: they may be many, and all together must weigh nothing."""


@dataclass(frozen=True)
class Posterior(Scale):
    """Chance that a pair is the expert's, given how uncertain it is: of pairs at .8, four in five.

    The share of the expert's among the unlabeled pairs is estimated, or given.

    Parameters
    ----------
    expert_share
        The share of the expert's pairs among the unlabeled ones, if it is known; None to estimate
        it.

    Raises
    ------
    InvalidInputError
        Unless 0 < expert_share < 1.

    Source
    ------
    w = π f_E(r) / f_U(r), not rising in r; the share π by the valley of f_U beside the held-out
    labeled pairs (see `expert_share`), in the place of Garg et al., Mixture Proportion Estimation
    and PU Learning, 2021.

    Examples
    --------
    >>> random = np.random.default_rng(0)
    >>> pool = np.concatenate([random.normal(size=100), 6 + random.normal(size=300)])
    >>> scale = sd.Posterior().fit(pool, random.normal(size=50))
    >>> round(scale.expert_share, 2), scale([0.0, 6.0]).round(2).tolist()
    (0.25, [1.0, 0.0])
    """

    kind: ClassVar[str] = "posterior"
    of_unlabeled: ClassVar[bool] = True
    expert_share: float | None = None

    def __post_init__(self) -> None:
        """Validate the share."""
        share = to_python_number(self.expert_share)
        if share is None:
            return
        number = isinstance(share, int | float) and not isinstance(share, bool)
        if not number or not 0 < share < 1:
            raise InvalidInputError(
                f"expert_share: expected 0 < share < 1, found {show_short(share)}"
            )
        object.__setattr__(self, "expert_share", float(share))

    def fit(
        self,
        pool_uncertainty: ArrayLike,
        held_out_labeled_uncertainty: ArrayLike | None = None,
        *,
        stretch: int = 1,
    ) -> Chance:
        """Estimate the share, and the chance as a function of uncertainty.

        Parameters
        ----------
        pool_uncertainty
            Of the unlabeled pairs, (n,).
        held_out_labeled_uncertainty
            Of labeled pairs that the estimator was not fitted on, (m,); None for none.
        stretch
            About how many neighboring pairs one value rests on.

        Raises
        ------
        InvalidInputError
            Without an unlabeled pair.
        """
        from ssil_data.scales.expert_share import Density, bound_share, find_cuts

        values = read_numbers("unlabeled uncertainty", pool_uncertainty)
        if not values.size:
            raise InvalidInputError(
                "posterior: needs unlabeled pairs, and every pair is labeled; choose another "
                "scale, such as conformal"
            )
        values = np.sort(check_finite("unlabeled uncertainty", values))
        held_out = None
        if held_out_labeled_uncertainty is not None:
            held_out = check_finite("held-out labeled uncertainty", held_out_labeled_uncertainty)
        if values[0] == values[-1]:
            return _same_for_all(values[0], self.expert_share)
        density = Density.of(values, independent=len(values) / stretch)
        cuts = find_cuts(values, density, held_out=held_out, stretch=stretch)
        width = density.width
        if self.expert_share is not None:
            cut = float(np.quantile(values, self.expert_share))
            interval = (self.expert_share, self.expert_share)
        elif not cuts:
            return _same_for_all(float(np.median(values)), None)
        else:
            cut = cuts[0].at
            interval = bound_share(cuts)
        if held_out is not None and (self.expert_share is not None or cuts[0].by_labels):
            width = max(width, 0.5 * float(held_out.std()))
        chance = density.chance_below(cut, width)
        share = self.expert_share
        if share is None:
            share = float(np.interp(values, density.centers, chance).mean())
        chance = _tilt(chance, np.searchsorted(values, density.centers) / len(values))
        low = min(interval[0], share)
        high = max(interval[1], share)
        return Chance(
            uncertainty=tuple(density.centers.tolist()),
            chance=tuple(chance.tolist()),
            expert_share=share,
            interval=(low, high),
        )


@dataclass(frozen=True)
class Chance(FittedScale):
    """Leverage by interpolation in a table of uncertainty and chance.

    Parameters
    ----------
    uncertainty
        Rising, at least two numbers.
    chance
        The chance at each, not rising.
    expert_share
        Estimated share of the expert's pairs among the unlabeled ones.
    interval
        Its bounds, of 90 %.

    Raises
    ------
    InvalidInputError
        For tables that do not fit each other.
    """

    kind: ClassVar[str] = "chance"
    uncertainty: Sequence[float]
    chance: Sequence[float]
    expert_share: float
    interval: Sequence[float]

    def __post_init__(self) -> None:
        """Validate the table and keep it as tuples."""
        check_fields(self.kind, self)
        places = check_finite("chance: uncertainty", self.uncertainty)
        chance = check_finite("chance: chance", self.chance)
        interval = check_finite("chance: interval", self.interval)
        sound = (
            places.shape == chance.shape
            and len(places) >= 2
            and (np.diff(places) > 0).all()
            and (np.diff(chance) <= 0).all()
            and (chance >= 0).all()
            and (chance <= 1).all()
            and interval.shape == (2,)
            and 0 <= interval[0] <= self.expert_share <= interval[1] <= 1
        )
        if not sound:
            raise InvalidInputError("chance: its numbers do not fit each other")
        object.__setattr__(self, "uncertainty", tuple(places.tolist()))
        object.__setattr__(self, "chance", tuple(chance.tolist()))
        object.__setattr__(self, "interval", tuple(interval.tolist()))

    def __call__(self, uncertainty: ArrayLike) -> NDArray[np.float32]:
        """Return the leverage (n,) of uncertainty (n,).

        Parameters
        ----------
        uncertainty
            (n,), not NaN.
        """
        r = check_numbers(uncertainty)
        return interpolate(r, np.array(self.uncertainty), np.array(self.chance))


def _tilt(chance: NDArray[np.float64], rank: NDArray[np.float64]) -> NDArray[np.float64]:
    """Let chances that are flat fall a little, so that ranks among sure pairs are not lost."""
    tilted = (1 - TILT_OF_OTHERS) * chance * (1 - TILT_OF_EXPERTS * rank)
    return tilted + TILT_OF_OTHERS * (1 - rank)


def _same_for_all(value: float, share: float | None) -> Chance:
    """Return one chance for every pair, where nothing tells them apart: the share, or a half."""
    known = share is not None
    chance = share if share is not None else 0.5
    return Chance(
        uncertainty=(value, float(np.nextafter(value, np.inf))),
        chance=(chance, chance),
        expert_share=chance,
        interval=(chance, chance) if known else (0.0, 1.0),
    )
