"""Long answers of a service, read page by page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pyarrow as pa

from ssil_data.client.connection import Connection
from ssil_data.client.wire import ARROW, decode


def read_pages(
    connection: Connection, path: str, version: str, params: Mapping[str, Any]
) -> Iterator[pa.Table]:
    """Read a table of one version of a dataset, page by page; at least one page, if without rows.

    Parameters
    ----------
    connection
        To the service.
    path
        Of the table.
    version
        The dataset's fingerprint.
    params
        Further query parameters; `limit` is the number of rows of a page, which the service may
        make smaller.

    Raises
    ------
    SsilDataError
        As `Connection.request` does.
    """
    offset = 0
    while True:
        page = {**params, "version": version, "offset": offset}
        answer = connection.request("GET", path, params=page, headers={"Accept": ARROW}, work=True)
        table = decode(answer.content)
        yield table.replace_schema_metadata(None)
        offset += len(table)
        if offset >= int(answer.headers["X-Total-Count"]) or not len(table):
            return


def read_table(
    connection: Connection, path: str, version: str, params: Mapping[str, Any] | None = None
) -> pa.Table:
    """Read all pages of a table of one version of a dataset.

    Parameters
    ----------
    connection, path, version, params
        See `read_pages`.
    """
    return pa.concat_tables(list(read_pages(connection, path, version, params or {})))
