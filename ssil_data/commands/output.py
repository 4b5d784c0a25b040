"""What commands share: where the store is, and how results and progress are shown."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any

from cyclopts import Parameter
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from ssil_data.scoring import Progress as Report
from ssil_data.store import Store


@dataclass(frozen=True)
class StoreLocation:
    """Where a command finds its datasets: `--store`, or SSIL_STORE in the environment.

    Parameters
    ----------
    store:
        Folder or object-store prefix of datasets.
    """

    store: Annotated[str, Parameter(env_var="SSIL_STORE")] = "datasets"

    def open(self) -> Store:
        """Open the store."""
        return Store(self.store)


StoreOption = Annotated[StoreLocation, Parameter(name="*")]
AsJson = Annotated[bool, Parameter(name="--json", negative=(), help="Print JSON for machines.")]


def print_json(value: Any) -> None:
    """Print a value as JSON on standard output.

    Parameters
    ----------
    value:
        What `json` can write. NaN and infinity are refused.
    """
    print(json.dumps(value, indent=2, allow_nan=False))


def print_table(title: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Print rows as a table on standard output.

    Parameters
    ----------
    title:
        Heading of the table.
    rows:
        Mappings with the same keys: the columns are those of the first row. Numbers are aligned
        right and floats rounded to three places. Text is printed as it is, never read as markup.
    """
    table = Table(title=Text(title, style="bold"), title_justify="left")
    for name in rows[0] if rows else ():
        numbers = any(isinstance(row[name], int | float) for row in rows)
        justify = "right" if numbers else "left"
        table.add_column(Text(name), justify=justify, overflow="fold")
    for row in rows:
        table.add_row(*(Text(_format(value)) for value in row.values()))
    console().print(table)


def console() -> Console:
    """Return a console on standard output: 160 columns where it is not a terminal."""
    return Console(width=None if sys.stdout.isatty() else 160, highlight=False)


def _format(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


@contextmanager
def progress() -> Iterator[Report]:
    """Show progress on standard error: bars on a terminal, a line per finished step elsewhere.

    Yields
    ------
    Callable
        To be called with what is done, how much of it, and how much there is in all.
    """
    if not sys.stderr.isatty():
        yield _print_step
        return
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True)) as bars:
        tasks: dict[str, Any] = {}

        def report(what: str, done: int, of: int) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=of)
            bars.update(tasks[what], completed=done)

        yield report


def _print_step(what: str, done: int, of: int) -> None:
    """Print a step once it is finished."""
    if done == of:
        print(f"{what}: {of:,} of {of:,}", file=sys.stderr)
