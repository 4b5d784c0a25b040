"""What each preset chooses: the parts of a recipe by the preset's name and the estimator's kind."""

from __future__ import annotations

from typing import Any

from ssil_data.errors import InvalidInputError
from ssil_data.estimators import ESTIMATORS, GPR, MDN, Ensemble
from ssil_data.pooling import Window
from ssil_data.scales import MinMax, Posterior
from ssil_data.scoring.recipe_checks import check_choice

PRESETS = ("default", "paper")
"""The names of the presets."""

PAPER_KINDS = ("vae", "windowvae", "mdn", "gpr")
"""The paper's estimators."""

SCALE_FLOOR = 0.3
"""Least scale of a dimension in the preset `default`, as a share of its deviation in the pool."""


def choose_parts(name: str, kind: str | None) -> dict[str, Any]:
    """Return the parts of a preset's recipe, by the names of the recipe's fields.

    Parameters
    ----------
    name
        `paper` or `default`.
    kind
        Kind of the estimator; None for the ensemble, which `default` alone has.

    Raises
    ------
    InvalidInputError
        For another name or kind, or the paper without one.
    """
    check_choice("preset", name, PRESETS)
    if kind is None and name == "paper":
        raise InvalidInputError(
            f"preset paper: needs an estimator; name one of the paper's, {list(PAPER_KINDS)}"
        )
    kind = Ensemble.kind if kind is None else kind
    check_choice("estimator", kind, ESTIMATORS)
    if name == "paper":
        if kind not in PAPER_KINDS:
            raise InvalidInputError(
                f"preset paper: expected one of the paper's estimators {list(PAPER_KINDS)}, "
                f"found {kind!r}"
            )
        return {"estimator": ESTIMATORS[kind](), "scale": MinMax(), "labeled_is_one": True}
    judges_action = {MDN.kind: MDN(surprisal=True), GPR.kind: GPR(surprisal=True)}
    return {
        "estimator": judges_action.get(kind) or ESTIMATORS[kind](),
        "scale": Posterior(),
        "pooling": Window(),
        "scale_floor": SCALE_FLOOR,
        "cross_fit": True,
    }
