"""Bodies of requests as JSON: states and pairs of queries, settings of runs."""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Annotated, Any, Literal, Union

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, create_model

from ssil_data.estimators import ESTIMATORS
from ssil_data.scales import SCALES

NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$"
_MOST = float(np.finfo(np.float32).max)
_MOST_INTEGER = 2**63 - 1


def _whole(value: Any) -> Any:
    """Convert 3.0 to 3: JSON has one kind of numbers."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


_Whole = BeforeValidator(_whole)
Name = Annotated[str, Field(pattern=NAME, examples=["racetrack"])]
Number = Annotated[float, Field(strict=True, ge=-_MOST, le=_MOST, allow_inf_nan=False)]
Integer = Annotated[int, Field(strict=True, ge=-(2**63), le=_MOST_INTEGER), _Whole]
Seed = Annotated[int, Field(strict=True, ge=0, le=_MOST_INTEGER), _Whole]
Row = Annotated[list[Number], Field(min_length=1)]


class Body(BaseModel):
    """A body whose unknown fields are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class StatesBody(Body):
    """States in raw units, one row each."""

    states: list[Row]


class PairsBody(Body):
    """Pairs in raw units; rows of one episode are adjacent and their steps rise by one."""

    states: list[Row]
    actions: list[Row]
    episode: list[Integer] | None = None
    step: list[Integer] | None = None


def _settings(kind: str, settings: type) -> type[BaseModel]:
    """Return a body with the fields and defaults of a settings dataclass, and its `kind`."""
    described: dict[str, Any] = {"kind": (Literal[kind], ...)}
    for field in fields(settings):
        default = field.default
        assert default is not MISSING
        if isinstance(default, bool):
            described[field.name] = (Annotated[bool, Field(strict=True)], default)
        elif isinstance(default, int):
            whole = Annotated[int, Field(strict=True, gt=0, le=10**6), _Whole]
            described[field.name] = (whole, default)
        else:
            real = Annotated[float, Field(strict=True, allow_inf_nan=False, **_bounds(kind))]
            described[field.name] = (real, default)
    title = settings.__name__
    return create_model(title, __base__=Body, __doc__=_first_line(settings), **described)


def _bounds(kind: str) -> dict[str, Any]:
    shares = {"quantile": {"ge": 0, "le": 1}, "conformal": {"gt": 0, "lt": 1}}
    return shares.get(kind, {"gt": 0, "le": _MOST})


def _first_line(settings: type) -> str:
    return (settings.__doc__ or "").partition("\n")[0]


EstimatorBody = Annotated[
    Union[tuple(_settings(kind, each) for kind, each in ESTIMATORS.items())],  # noqa: UP007
    Field(discriminator="kind"),
]
ScaleBody = Annotated[
    Union[tuple(_settings(kind, each) for kind, each in SCALES.items())],  # noqa: UP007
    Field(discriminator="kind"),
]


class FitBody(Body):
    """Fit an estimator on the labeled pairs and give every pair a leverage."""

    estimator: EstimatorBody  # pyright: ignore[reportInvalidTypeForm]
    scale: ScaleBody = Field(default_factory=lambda: _quantile(), validate_default=True)  # pyright: ignore
    labeled_is_one: Annotated[bool, Field(strict=True)] = False
    seed: Seed = 0
    run: Name | None = None
    version: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")] | None = None


class FittedRun(Body):
    """A run whose fitted estimator and scale are used again."""

    dataset: Name | None = None
    run: Name


class RescoreBody(Body):
    """Give every pair a leverage with the fitted estimator and scale of another run."""

    fitted: FittedRun
    run: Name | None = None
    version: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")] | None = None


def _quantile() -> Any:
    return {"kind": "quantile"}
