"""Bodies of requests as JSON: states and pairs of queries, recipes of runs."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Any

from pydantic import ConfigDict, Field

from ssil_data.scales import Quantile
from ssil_data.scoring import Recipe, preset
from ssil_service.schemas.settings import (
    MOST,
    WHOLE,
    Body,
    EstimatorBody,
    PoolingBody,
    ScaleBody,
)

NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$"
_MOST_INTEGER = 2**63 - 1

Name = Annotated[str, Field(pattern=NAME, examples=["racetrack"])]
Number = Annotated[float, Field(strict=True, ge=-MOST, le=MOST, allow_inf_nan=False)]
Integer = Annotated[int, Field(strict=True, ge=-(2**63), le=_MOST_INTEGER), WHOLE]
Seed = Annotated[int, Field(strict=True, ge=0, le=_MOST_INTEGER), WHOLE]
Count = Annotated[int, Field(strict=True, ge=2, le=_MOST_INTEGER), WHOLE]
Share = Annotated[float, Field(strict=True, ge=0, le=MOST, allow_inf_nan=False)]
Switch = Annotated[bool, Field(strict=True)]
Row = Annotated[list[Number], Field(min_length=1)]


class StatesBody(Body):
    """States in raw units, one row each."""

    states: list[Row]


class PairsBody(Body):
    """Pairs in raw units; rows of one episode are adjacent and their steps rise by one.

    Without `episode`, all rows are one episode. Uncertainty is pooled inside the episodes of one
    request: a pair that comes alone is judged alone.
    """

    states: list[Row]
    actions: list[Row]
    episode: list[Integer] | None = None
    step: list[Integer] | None = None


_FIT_EXAMPLES: Any = [
    {"seed": 0, "run": "first"},
    {"estimator": {"kind": "windowvae", "steps": 50}, "seed": 0},
    {
        "estimator": {"kind": "ensemble", "members": [{"kind": "vae"}, {"kind": "contrast"}]},
        "pooling": {"kind": "hmm"},
        "scale": {"kind": "posterior", "expert_share": 0.1},
        "scale_floor": 0.3,
        "cross_fit": True,
    },
]


class FitBody(Body):
    """Fit an estimator on the labeled pairs and give every pair a leverage.

    Without an estimator the recipe is the preset `default`, and every other key that is given
    replaces a choice of it. With one, an absent scale is `quantile`, and all else absent is off.
    """

    model_config = ConfigDict(json_schema_extra={"examples": _FIT_EXAMPLES})

    estimator: EstimatorBody | None = None  # pyright: ignore[reportInvalidTypeForm]
    scale: ScaleBody | None = None  # pyright: ignore[reportInvalidTypeForm]
    labeled_is_one: Switch | None = Field(None, description="Labeled pairs get leverage 1.")
    pooling: PoolingBody | None = Field(  # pyright: ignore[reportInvalidTypeForm]
        None, description="How uncertainty is pooled over time, inside each episode."
    )
    scale_floor: Share | None = Field(
        None,
        description="Least scale of a dimension: a share of its deviation among unlabeled pairs.",
    )
    cross_fit: Switch | None = Field(
        None, description="Judge labeled pairs by estimators that were not fitted on them."
    )
    self_training: Switch | None = Field(
        None, description="Fit again with the purest unlabeled pairs, if they are pure enough."
    )
    labels: Count | None = Field(
        None, description="Fit on only so many labeled pairs, the first ones; absent: on all."
    )
    seed: Seed = 0
    run: Name | None = None
    version: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")] | None = None

    def recipe(self) -> Recipe:
        """Return the recipe that the body describes.

        Returns
        -------
        Recipe
            What is absent is that of the preset `default`; with an estimator, what it was before
            there was more to choose.

        Raises
        ------
        InvalidInputError
            For settings that contradict each other.
        """
        names = {field.name for field in fields(Recipe)}
        given = self.model_dump(include=names, exclude_none=True)
        if self.estimator is None:
            return Recipe.from_json({**preset("default").to_json(), **given})
        absent = {"scale": {"kind": Quantile.kind}, "labeled_is_one": False}
        return Recipe.from_json({**absent, **given})


class FittedRun(Body):
    """A run whose fitted estimator and scale are used again."""

    dataset: Name | None = None
    run: Name


class RescoreBody(Body):
    """Give every pair a leverage with the fitted estimator and scale of another run."""

    fitted: FittedRun
    run: Name | None = None
    version: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")] | None = None
