"""Path and query parameters of the routes; a query parameter that a route does not have is refused.

A route declares its query parameters as one model, `Annotated[…Parameters, Query()]`, which forbids
all others. Routes without any depend on `NO_PARAMETERS`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Annotated, Any, Literal

from fastapi import Depends, Path, Query
from pydantic import BaseModel, ConfigDict

from ssil_data.field import LCoRQuery
from ssil_data.store.arrow_schema import VALUES
from ssil_service.problems import SHOWN, Fault, Problem, of_validation
from ssil_service.schemas.requests import NAME

MOST_CONTRIBUTORS = 256
MOST_SECONDS = 60.0
_MOST_INTEGER = 2**63 - 1
_LCOR_OPTIONS = tuple(option.name for option in fields(LCoRQuery))

DatasetName = Annotated[str, Path(pattern=NAME, description="A dataset of the store.")]
RunName = Annotated[str, Path(pattern=NAME, description="A run of the dataset.")]

Index = Annotated[int, Query(ge=0, le=_MOST_INTEGER)]
Text = Annotated[str, Query(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f]*$")]
Column = Annotated[Text | None, Query(description="A column of the file.")]
ColumnList = Annotated[list[Text] | None, Query(description="Columns of the file, in this order.")]


class Parameters(BaseModel):
    """The query parameters of a route; all others are refused by name."""

    model_config = ConfigDict(extra="forbid", frozen=True)


async def refuse_parameters(_none: Annotated[Parameters, Query()]) -> None:
    """Refuse all query parameters."""


NO_PARAMETERS = Depends(refuse_parameters)
"""Dependency of a route, or of a router, that takes no query parameters."""


class VersionParameters(Parameters):
    """Which version of a dataset a route reads."""

    version: Annotated[
        str | None,
        Query(
            pattern=r"^[0-9a-f]{16}$", description="The dataset's fingerprint; the newest without."
        ),
    ] = None


class PageParameters(VersionParameters):
    """Which rows of a long answer are returned."""

    offset: Annotated[Index, Query(description="Rows to leave out.")] = 0
    limit: Annotated[
        int | None,
        Query(
            ge=1,
            le=_MOST_INTEGER,
            description="Rows at most; `/v1/limits` has the ceiling.",
        ),
    ] = None


class PairsParameters(PageParameters):
    """Which pairs are returned, and which columns of them."""

    episode: Annotated[Index | None, Query(description="Rows of this episode only.")] = None
    labeled: Annotated[bool, Query(description="Labeled pairs only.")] = False
    recorded: Annotated[
        Literal["reward", "position"] | None,
        Query(description="Instead of states and actions, what was recorded for evaluation."),
    ] = None


class LeverageParameters(PageParameters):
    """Which values of a run are returned."""

    episode: Annotated[Index | None, Query(description="Rows of this episode only.")] = None
    first_step: Index | None = None
    last_step: Index | None = None
    columns: Annotated[
        list[Literal[tuple(VALUES.names)]] | None,  # pyright: ignore[reportInvalidTypeForm]
        Query(description="These columns; those of the first version, up to leverage, if absent."),
    ] = None


class CoRParameters(VersionParameters):
    """The options of a CoR query."""

    alpha: Annotated[
        float | None,
        Query(ge=1e-6, le=1e8, allow_inf_nan=False, description="Sharpness instead of the run's."),
    ] = None


class LCoRParameters(CoRParameters):
    """The options of an LCoR query: those of `LCoRQuery`, within the limits of the service."""

    contributors: Annotated[
        int,
        Query(
            ge=0,
            le=MOST_CONTRIBUTORS,
            description="Also name this many states that weigh most.",
        ),
    ] = LCoRQuery.contributors
    tolerance: Annotated[
        float | None,
        Query(
            gt=0,
            le=1e9,
            allow_inf_nan=False,
            description="Use a random part of the pairs, for 99.9 % half-widths this small.",
        ),
    ] = LCoRQuery.tolerance
    relative: Annotated[
        bool, Query(description="Tolerance in deviations of LCoR over the demonstrations.")
    ] = LCoRQuery.relative
    seconds: Annotated[
        float | None,
        Query(
            gt=0,
            le=MOST_SECONDS,
            allow_inf_nan=False,
            description="Use as large a random part of the pairs as this time allows.",
        ),
    ] = LCoRQuery.seconds
    seed: Annotated[Index, Query(description="Equal seeds, equal parts.")] = LCoRQuery.seed
    sums: Annotated[
        bool, Query(description="Instead, the weighted sums, which add up over shards.")
    ] = False

    def query(self) -> LCoRQuery:
        """Return the options as the library takes them; raises InvalidInputError for conflicts."""
        return LCoRQuery(**{name: getattr(self, name) for name in _LCOR_OPTIONS})

    def refuse_sampling_with_sums(self) -> None:
        """Raise a Problem if sums over all pairs are to be made from a random part of them."""
        if not self.sums:
            return
        faults = [
            Fault(detail=f"{name}: sums are exact and take no such option", field=name)
            for name in ("tolerance", "relative", "seconds", "seed")
            if name in self.model_fields_set
        ]
        if faults:
            raise Problem(422, f"query: {faults[0].detail}", errors=faults)


class LayoutParameters(Parameters):
    """Which columns of an upload are what, as `ssil-data import` takes them."""

    state: ColumnList = None
    action: ColumnList = None
    episode: Column = None
    step: Column = None
    reward: Column = None
    position: ColumnList = None
    score: Column = None
    tier: Column = None
    labeled: Annotated[
        list[Text] | None,
        Query(description="Expert episodes: their values, `all`, or a column of truth values."),
    ] = None
    file: Annotated[str, Query(pattern=r"^[A-Za-z0-9._-]{1,100}$")] = "upload"

    def columns(self) -> dict[str, Any]:
        """Return the layout as JSON: lists of columns, which may be empty, and single ones."""
        several = ("state", "action", "position", "labeled")
        given = self.model_dump(exclude={"file"})
        return {name: value or [] if name in several else value for name, value in given.items()}


def of_invalid_request(errors: Sequence[Mapping[str, Any]]) -> Problem:
    """Return what is wrong with a request's parameters as one problem; unknown names come first."""
    unknown = [
        str(error["loc"][-1])[:100]
        for error in errors
        if error["type"] == "extra_forbidden" and error["loc"][0] == "query"
    ]
    if not unknown:
        return of_validation(errors, "request")
    faults = [Fault(detail=f"{name}: no such parameter", field=name) for name in unknown[:SHOWN]]
    return Problem(422, f"query: {faults[0].detail}", errors=faults)
