"""The store of a service: datasets by name, as `ssil_data.Store` has them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from types import TracebackType
from typing import Any, Self

import httpx

from ssil_data.client.connection import Connection, RetryPolicy
from ssil_data.client.dataset import RemoteDataset
from ssil_data.client.upload import episodes_body
from ssil_data.client.wire import ARROW
from ssil_data.demonstrations import Episode
from ssil_data.errors import NotFoundError
from ssil_data.store.folder import check_name


class RemoteStore:
    """Datasets by name, at a service; a context manager that closes its connections.

    Parameters
    ----------
    connection
        To the service.

    Examples
    --------
    >>> remote.names()
    ['drives']
    >>> "drives" in remote, "nope" in remote
    (True, False)
    """

    def __init__(self, connection: Connection) -> None:
        self.connection = connection

    def __enter__(self) -> Self:
        """Return the store."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the connections."""
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self.connection.client.close()

    def __repr__(self) -> str:
        """Show the location."""
        return f"RemoteStore({str(self.connection.client.base_url)!r})"

    def __contains__(self, name: str) -> bool:
        """Tell whether a dataset of that name exists."""
        try:
            self._summary(name)
        except NotFoundError:
            return False
        return True

    def __iter__(self) -> Iterator[RemoteDataset]:
        """Go through the datasets in the order of their names."""
        return (self[name] for name in self.names())

    def __getitem__(self, name: str) -> RemoteDataset:
        """Open the newest version of a dataset.

        Parameters
        ----------
        name
            The dataset's name.

        Raises
        ------
        NotFoundError
            If no dataset has the name.
        """
        return RemoteDataset(self.connection, self._summary(name), self.limits)

    @cached_property
    def limits(self) -> dict[str, Any]:
        """What the service takes at most, by name."""
        return self.connection.json("GET", "v1/limits")

    def names(self) -> list[str]:
        """List the names of the datasets, sorted."""
        listed = self.connection.json("GET", "v1/datasets")
        return [dataset["dataset"] for dataset in listed["datasets"]]

    def create(
        self,
        name: str,
        episodes: Iterable[Episode],
        *,
        state_names: Sequence[str],
        action_names: Sequence[str],
        card: str = "",
    ) -> RemoteDataset:
        """Write a new dataset; it appears whole, at the end, or not at all.

        Parameters
        ----------
        name
            The dataset's name.
        episodes
            At least one.
        state_names, action_names
            The names of the dimensions.
        card
            The dataset's card, Markdown; the files' checksums are added to it.

        Returns
        -------
        RemoteDataset
            Its first version.

        Raises
        ------
        ConflictError
            If the name is taken.
        InvalidInputError
            For episodes of another width, or none.
        """
        body = episodes_body(episodes, state_names, action_names, card)
        path = f"v1/datasets/{check_name('dataset', name)}"
        headers = {"Content-Type": ARROW}
        summary = self.connection.json("PUT", path, content=body, headers=headers, work=True)
        return RemoteDataset(self.connection, summary, self.limits)

    def delete(self, name: str) -> None:
        """Delete a dataset with its runs.

        Parameters
        ----------
        name
            The dataset's name.

        Raises
        ------
        NotFoundError
            If no dataset has the name.
        ConflictError
            While a job or an upload works on it.
        """
        path = f"v1/datasets/{check_name('dataset', name)}"
        self.connection.request("DELETE", path, work=True)

    def _summary(self, name: str) -> dict[str, Any]:
        path = f"v1/datasets/{check_name('dataset', name)}"
        return self.connection.json("GET", path)


def connect(
    url: str,
    api_key: str | None = None,
    *,
    timeout: float = 30.0,
    work_timeout: float = 3600.0,
    retry: RetryPolicy = RetryPolicy(),  # noqa: B008
    transport: httpx.BaseTransport | None = None,
) -> RemoteStore:
    """Return the store that a service serves: the methods of `Store`, and the same numbers.

    Nothing is sent before it is needed. The result is a context manager that closes its
    connections; several threads may share it.

    Parameters
    ----------
    url
        Of the service, as "http://127.0.0.1:8000".
    api_key
        Its read or write key, if it has any.
    timeout
        Seconds for connecting, and for each read or write.
    work_timeout
        Seconds for the response to what takes work: uploads, deletes, queries, bulk reads.
    retry
        How long a busy or unreachable service is tried again.
    transport
        Sends the requests in some other way than by socket, as an embedded service does.

    Returns
    -------
    RemoteStore
        Datasets by name.

    Examples
    --------
    >>> with sd.connect("http://127.0.0.1:8000") as service:
    ...     service
    RemoteStore('http://127.0.0.1:8000')
    """
    headers = {} if api_key is None else {"Authorization": f"Bearer {api_key}"}
    client = httpx.Client(
        base_url=url,
        headers={**headers, "User-Agent": "ssil-data"},
        timeout=timeout,
        transport=transport,
        limits=httpx.Limits(max_connections=64, max_keepalive_connections=16),
    )
    return RemoteStore(Connection(client, retry, work_timeout))
