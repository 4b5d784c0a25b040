"""Settings of a run as JSON bodies: estimators, poolings and scales, each by its `kind`.

They are made from the library's own dataclasses, whose fields and defaults they have.
"""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Annotated, Any, Literal, Union

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, create_model

from ssil_data.estimators import ESTIMATORS, Ensemble
from ssil_data.pooling import POOLINGS
from ssil_data.pooling.hidden_markov import MOST_BINS
from ssil_data.pooling.window import WIDEST
from ssil_data.scales import SCALES

MOST = float(np.finfo(np.float32).max)


def _whole(value: Any) -> Any:
    """Convert 3.0 to 3: JSON has one kind of numbers."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


WHOLE = BeforeValidator(_whole)

_POSITIVE: dict[str, Any] = {"gt": 0, "le": MOST}
_SHARE: dict[str, Any] = {"gt": 0, "lt": 1}
_BOUNDS: dict[str, dict[str, Any]] = {
    "low": {"ge": 0, "le": 1},
    "high": {"ge": 0, "le": 1},
    "held_out": _SHARE,
    "expert_share": _SHARE,
    "start_share": _SHARE,
}
"""Bounds of numbers by their names; another is positive."""
_WHOLE_BOUNDS = {"bins": (2, MOST_BINS), "half_width": (1, WIDEST)}
"""Bounds of whole numbers by their names."""


class Body(BaseModel):
    """A body whose unknown fields are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def _settings(kind: str, settings: type) -> type[BaseModel]:
    """Return a body with the fields and defaults of a settings dataclass, and its `kind`."""
    described: dict[str, Any] = {"kind": (Literal[kind], ...)}
    for field in fields(settings):
        default = field.default
        assert default is not MISSING
        if isinstance(default, bool):
            described[field.name] = (Annotated[bool, Field(strict=True)], default)
        elif isinstance(default, int):
            least, most = _WHOLE_BOUNDS.get(field.name, (1, 10**6))
            whole = Annotated[int, Field(strict=True, ge=least, le=most), WHOLE]
            described[field.name] = (whole, default)
        else:
            bounds = _BOUNDS.get(field.name, _POSITIVE)
            real: Any = Annotated[float, Field(strict=True, allow_inf_nan=False, **bounds)]
            described[field.name] = (real | None if default is None else real, default)
    title = settings.__name__
    return create_model(title, __base__=Body, __doc__=_first_line(settings), **described)


def _any_kind(bodies: list[Any]) -> Any:
    """Return a body that is one of several, by its `kind`."""
    return Annotated[Union[tuple(bodies)], Field(discriminator="kind")]  # noqa: UP007


def _first_line(settings: type) -> str:
    return (settings.__doc__ or "").partition("\n")[0]


_SINGLE = [_settings(kind, each) for kind, each in ESTIMATORS.items() if kind != Ensemble.kind]
_MEMBERS = Field(
    min_length=2,
    max_length=len(_SINGLE),
    description="Estimators of different kinds; absent: those that measured best together.",
)
_ENSEMBLE: dict[str, Any] = {
    "kind": (Literal["ensemble"], ...),
    "members": (Annotated[list[_any_kind(_SINGLE)] | None, _MEMBERS], None),
}

EnsembleBody = create_model("Ensemble", __base__=Body, __doc__=_first_line(Ensemble), **_ENSEMBLE)
EstimatorBody = _any_kind([*_SINGLE, EnsembleBody])
ScaleBody = _any_kind([_settings(kind, each) for kind, each in SCALES.items()])
PoolingBody = _any_kind([_settings(kind, each) for kind, each in POOLINGS.items()])
