"""Bodies of requests: their media type, and their content as arrays or settings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from fastapi import Request
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError

from ssil_data.client.wire import ARROW, JSON, PARQUET
from ssil_data.demonstrations import Pairs
from ssil_service.context import context
from ssil_service.formats import query_bodies
from ssil_service.problems import Problem, of_validation

Model = TypeVar("Model", bound=BaseModel)
RUN_BYTES = 65_536
"""Largest body that requests a run: settings, and nothing else."""


def media_type(
    request: Request, offered: Sequence[str] = (JSON, ARROW, PARQUET), *, unnamed: str = ""
) -> str:
    """Return the media type of a request's body.

    Parameters
    ----------
    request
        The request.
    offered
        Media types that the route takes.
    unnamed
        Media type of a body without `Content-Type`; without it, such a body is refused.

    Returns
    -------
    str
        One of those offered.

    Raises
    ------
    Problem
        415 for another media type, or any content coding.
    """
    if request.headers.get("content-encoding", "identity").lower() != "identity":
        raise Problem(415, "Content-Encoding: send the body without one")
    given = request.headers.get("content-type", unnamed).partition(";")[0].strip().lower()
    if given not in offered:
        raise Problem(415, f"Content-Type: only {', '.join(offered)} can be read")
    return given


def read_settings_body(body: bytes, model: type[Model]) -> Model:
    """Read a small JSON body as a model.

    Parameters
    ----------
    body
        JSON.
    model
        What it must be.

    Returns
    -------
    BaseModel
        An instance of the model.

    Raises
    ------
    Problem
        413 for more than `RUN_BYTES`, 422 naming every offending place.
    """
    if len(body) > RUN_BYTES:
        raise Problem(413, f"body: expected at most {RUN_BYTES} bytes of settings, found more")
    try:
        return model.model_validate_json(body)
    except ValidationError as error:
        found = error.errors(include_url=False, include_context=False, include_input=False)
        raise of_validation(found, "body") from None


async def read_states(request: Request, width: int) -> NDArray[np.float32]:
    """Read the states of a query.

    Parameters
    ----------
    request
        Its body is JSON, Arrow or Parquet.
    width
        Dimensions of a state.

    Returns
    -------
    NDArray
        (m, width), finite, in raw units.

    Raises
    ------
    Problem
        What is wrong with the body, and 503 if too many long JSON bodies wait.
    """
    media, body = await _read_body(request)
    here = context(request)
    most_rows = here.settings.query_rows
    return await here.convert(
        len(body),
        lambda: query_bodies.read_states(body, media, width=width, most_rows=most_rows),
        media,
    )


async def read_pairs(request: Request, widths: tuple[int, int]) -> Pairs:
    """Read the state-action pairs of a query; without episode and step they are one episode.

    Parameters
    ----------
    request
        Its body is JSON, Arrow or Parquet.
    widths
        Dimensions of a state and of an action.

    Returns
    -------
    Pairs
        The pairs, finite, in raw units.

    Raises
    ------
    Problem
        What is wrong with the body, and 503 if too many long JSON bodies wait.
    """
    media, body = await _read_body(request)
    here = context(request)
    most_rows = here.settings.query_rows
    return await here.convert(
        len(body),
        lambda: query_bodies.read_pairs(body, media, widths=widths, most_rows=most_rows),
        media,
    )


async def _read_body(request: Request) -> tuple[str, bytes]:
    """Return media type and body; Parquet is decoded in a worker process, and then is Arrow."""
    media = media_type(request)
    body = await request.body()
    if media == PARQUET:
        return ARROW, await context(request).decoder.arrow(body)
    return media, body
