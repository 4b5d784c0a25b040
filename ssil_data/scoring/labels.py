"""Which labeled pairs a run may rest on, and whether there is anything to compare them with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.errors import InvalidInputError
from ssil_data.json_kinds import show_short
from ssil_data.scoring.recipes import Recipe


def take_labels(labeled: Pairs, count: int | None) -> Pairs:
    """Return the first labeled pairs.

    Parameters
    ----------
    labeled
        All labeled pairs, (m,).
    count
        How many to take; None for all.

    Raises
    ------
    InvalidInputError
        For fewer than two, or more than there are.
    """
    if count is None:
        return labeled
    check_label_count(count, len(labeled))
    return labeled[:count]


def check_label_count(count: int, labeled: int) -> None:
    """Refuse a number of labels that no run can rest on.

    Parameters
    ----------
    count
        How many labeled pairs are to be taken.
    labeled
        How many there are.

    Raises
    ------
    InvalidInputError
        For fewer than two, or more than there are.
    """
    whole = isinstance(count, int) and not isinstance(count, bool)
    if not whole or not 2 <= count <= labeled:
        raise InvalidInputError(
            f"labels: expected a whole number from 2 to {labeled}, the labeled pairs, "
            f"found {show_short(count)}"
        )


def check_unlabeled(recipe: Recipe, labeled: NDArray[np.bool_]) -> None:
    """Refuse a recipe that compares the expert with unlabeled pairs where there are none.

    Parameters
    ----------
    recipe
        How the run is to be made.
    labeled
        Whether each pair, or each episode, is labeled, (n,).

    Raises
    ------
    InvalidInputError
        If all are labeled and the estimator or the scale needs unlabeled ones.
    """
    if not labeled.all():
        return
    if recipe.estimator.needs_unlabeled or recipe.scale.of_unlabeled:
        raise InvalidInputError(
            "score: every pair is labeled, so there is nothing to compare the expert with; import "
            "the demonstrations of unknown quality too, or choose an estimator and a scale that "
            "need none: --estimator windowvae --scale conformal"
        )
