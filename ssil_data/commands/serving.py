"""Opens the store that a command works on: through a service at a URL, or one in this process.

Commands that train read their rewards through the service's own client, so that a training job
does the same thing on one machine and beside a service elsewhere. Without a URL the service is
embedded: started inside this process, without a socket. Its package is imported by name, because
the library must also work where the service is not installed; there the store is read directly.
All three ways give the same numbers, bit for bit.
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
from ssil_data.commands.output import StoreLocation
from ssil_data.surface import DatasetLike, StoreLike

API_KEY_VARIABLE = "SSIL_API_KEY"
"""Environment variable with the key for a service at a URL."""
CONNECT_TIMEOUT = 10.0
"""Seconds that a service may take to give its first answer, when a command starts."""
RETRY_TIMEOUT = 3600.0
"""Seconds that a service may be away or busy afterwards, before a command gives up."""
SILENT_ATTEMPTS = 4
"""Attempts before a wait is announced: half a second, or as many waits as the service named."""
SERVICE_PACKAGES = frozenset(
    {"ssil_service", "fastapi", "starlette", "pydantic", "pydantic_core", "pydantic_settings"}
    | {"prometheus_client", "uvicorn", "h11"}
)
"""Packages of the `service` extra: if one of them is missing, the service is not installed."""


@contextmanager
def open_store(location: StoreLocation, service: str | None) -> Iterator[StoreLike[DatasetLike]]:
    """Open the store through a service: the one at a URL, or an embedded one.

    Parameters
    ----------
    location:
        Where the store is; used when `service` is None.
    service:
        URL of a service, which is sent the key in SSIL_API_KEY if there is one. It must answer
        within ten seconds; afterwards it may be away for an hour, which is announced on standard
        error. None embeds a service in this process, or reads the store directly where the service
        is not installed. An embedded service writes to the store only what its client asks for.

    Yields
    ------
    StoreLike
        The same methods and the same numbers either way.

    Raises
    ------
    ServiceError
        If the service at the URL does not answer, or refuses the key.
    """
    if service is not None:
        with _connect(service) as store:
            yield store
        return
    try:
        embed = import_module("ssil_service").embed
    except ModuleNotFoundError as error:
        if error.name not in SERVICE_PACKAGES:
            raise
        yield location.open()
        return
    with (
        TemporaryDirectory() as state,
        embed(location.store, state=state, read_key=None, write_key=None) as store,
    ):
        yield store


@contextmanager
def _connect(url: str) -> Iterator[RemoteStore]:
    """Connect once with a short time-out, to fail early, and then with a long one."""
    key = os.environ.get(API_KEY_VARIABLE)
    policy = AnnouncedRetry(total=RETRY_TIMEOUT, url=url)
    with connect(url, key, retry=replace(policy, total=CONNECT_TIMEOUT)) as store:
        _ = store.limits
    with connect(url, key, retry=policy) as store:
        yield store


@dataclass(frozen=True)
class AnnouncedRetry(RetryPolicy):
    """A retry policy that says on standard error that it waits, once per request.

    Parameters
    ----------
    url:
        The service, as it is named in the announcement.
    """

    url: str = ""

    def seconds_before(self, attempt: int, announced: float) -> float:
        """Return the seconds before an attempt, after announcing a wait that lasts.

        Parameters
        ----------
        attempt:
            How many attempts failed before the last one.
        announced:
            Seconds that the service asks its clients to wait, 0 for none.
        """
        if attempt == SILENT_ATTEMPTS:
            print(f"Waiting for {self.url}, which is busy or away ...", file=sys.stderr, flush=True)
        return super().seconds_before(attempt, announced)
