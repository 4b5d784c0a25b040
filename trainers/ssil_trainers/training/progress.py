"""What a training run shows while it goes on: a progress line, and TensorBoard events."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from ssil_trainers.training.history import HistoryRow
from ssil_trainers.training.run import Callback

if TYPE_CHECKING:
    from torch.utils.tensorboard.writer import SummaryWriter


@contextmanager
def progress_display(title: str, iterations: int) -> Iterator[Callback]:
    """Show score, η, the discriminator's accuracy, KL and steps/s on standard error.

    Parameters
    ----------
    title:
        What is trained.
    iterations:
        How many iterations there will be.

    Yields
    ------
    Callback
        Shows a row: as a moving line on a terminal, and elsewhere as a line for each evaluation.

    Examples
    --------
    >>> with progress_display("gail Pendulum-v1", 10) as show:
    ...     show(HistoryRow(0, None, None))
    """
    text = _ProgressText(title)
    if not sys.stderr.isatty():

        def print_evaluation(row: HistoryRow) -> None:
            line = text(row)
            if row.evaluation is not None:
                print(line, file=sys.stderr)

        yield print_evaluation
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bars:
        bar = bars.add_task(title, total=iterations)

        def move_bar(row: HistoryRow) -> None:
            done = 0 if row.iteration is None else row.iteration.number
            bars.update(bar, description=text(row), completed=done)

        yield move_bar


class _ProgressText:
    """Puts the latest figures into one line; remembers the last score and when it started."""

    def __init__(self, title: str) -> None:
        self.title = title
        self.score = ""
        self.start: tuple[float, int] | None = None

    def __call__(self, row: HistoryRow) -> str:
        if row.evaluation is not None:
            score = row.evaluation.score
            mean = row.evaluation.mean
            self.score = f"return {mean:,.1f}" if score is None else f"score {score:.3f}"
        parts = [self.title, f"{row.steps:,} steps", self.score]
        if row.iteration is not None:
            figures = row.iteration
            parts += [f"η {figures.eta:.3f}", f"D {figures.accuracy:.2f}", f"KL {figures.kl:.4f}"]
        parts.append(self._rate(row.steps))
        return "  ".join(filter(None, parts))

    def _rate(self, steps: int) -> str:
        """Return the steps per second since the first row; nothing at the first row itself."""
        now = time.perf_counter()
        if self.start is None:
            self.start = (now, steps)
            return ""
        start, first_steps = self.start
        return f"{(steps - first_steps) / (now - start):,.0f} steps/s"


@contextmanager
def tensorboard(folder: Path, callback: Callback) -> Iterator[Callback]:
    """Also write every figure as a TensorBoard event.

    Parameters
    ----------
    folder:
        Where the events go; it is made with the first one.
    callback:
        Called with every row before its events are written.

    Yields
    ------
    Callback
        Passes a row on, and writes its events.

    Examples
    --------
    >>> with tensorboard(Path("events"), lambda row: None) as write:
    ...     write(HistoryRow(0, None, None))
    >>> [path.name.partition(".")[0] for path in Path("events").iterdir()]
    ['events']
    """
    with ExitStack() as stack:
        writers: list[SummaryWriter] = []

        def write_events(row: HistoryRow) -> None:
            callback(row)
            if not writers:
                writers.append(stack.enter_context(closing(_open_writer(folder))))
            for name, value in row.figures().items():
                if value is not None and name not in ("steps", "number"):
                    writers[0].add_scalar(name, value, row.steps)

        yield write_events


def _open_writer(folder: Path) -> SummaryWriter:
    """Open a TensorBoard writer; its package is imported only when it is used."""
    from torch.utils.tensorboard.writer import SummaryWriter

    return SummaryWriter(str(folder))
