"""Where a command asks: a service at an address, one inside this process, or the store itself.

The service is named by its import path, as its subcommand is: the library stands without it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from tempfile import TemporaryDirectory

from ssil_data.client import RemoteStore, RetryPolicy, connect
from ssil_data.commands.output import Place
from ssil_data.store import Store

KEY = "SSIL_API_KEY"
AT_FIRST, LATER = 10.0, 3600.0
"""Seconds that a service may take to answer: when a command starts, and once it did."""
_OF_SERVICE = frozenset(
    {"ssil_service", "fastapi", "starlette", "pydantic", "pydantic_core", "pydantic_settings"}
    | {"prometheus_client", "uvicorn", "h11"}
)
"""What an installation without the service lacks; anything else that is missing is a fault."""
_SILENT = 4
"""Attempts without a word: half a second of waiting, or as many waits as the service asks for."""


@contextmanager
def open_store(place: Place, service: str | None) -> Iterator[Store | RemoteStore]:
    """Open the store behind a service: at the URL `service`, or in this process without one.

    An embedded service writes nothing but what it is asked to write. Where it is not installed, the
    store itself is opened: the same surface, the same bits. A service at a URL is given the key in
    SSIL_API_KEY; once it has answered, it may be away for an hour. Raises ServiceError.
    """
    if service is not None:
        with _connect(service) as store:
            yield store
        return
    try:
        embed = import_module("ssil_service").embed
    except ModuleNotFoundError as error:
        if error.name not in _OF_SERVICE:
            raise
        yield place.open()
        return
    with (
        TemporaryDirectory() as state,
        embed(place.store, state=state, read_key=None, write_key=None) as store,
    ):
        yield store


@contextmanager
def _connect(url: str) -> Iterator[RemoteStore]:
    key, patience = os.environ.get(KEY), _Told(total=LATER, url=url)
    with connect(url, key, patience=replace(patience, total=AT_FIRST)) as store:
        _ = store.limits
    with connect(url, key, patience=patience) as store:
        yield store


@dataclass(frozen=True)
class _Told(RetryPolicy):
    """Patience that says on standard error that it waits, once for every question."""

    url: str = ""

    def seconds_before(self, attempt: int, asked: float) -> float:
        if attempt == _SILENT:
            print(f"Waiting for {self.url}, which is busy or away ...", file=sys.stderr, flush=True)
        return super().seconds_before(attempt, asked)
