"""How a training run is watched: a line that moves on a terminal, lines elsewhere, TensorBoard."""

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
def progress_display(what: str, iterations: int) -> Iterator[Callback]:
    """Show score, η, discriminator's accuracy, KL and steps/s on standard error."""
    tell = _ProgressText(what)
    if not sys.stderr.isatty():
        yield lambda moment: print(tell(moment), file=sys.stderr) if moment.evaluation else None
        return
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    text = TextColumn("{task.description}", markup=False)
    with Progress(text, *columns, console=Console(stderr=True)) as bars:
        bar = bars.add_task(what, total=iterations)

        def show(moment: HistoryRow) -> None:
            done = 0 if moment.iteration is None else moment.iteration.number
            bars.update(bar, description=tell(moment), completed=done)

        yield show


class _ProgressText:
    """Puts the latest figures into one line; remembers the last score and the clock."""

    def __init__(self, what: str) -> None:
        self.what, self.score = what, ""
        self.clock: tuple[float, int] | None = None

    def __call__(self, moment: HistoryRow) -> str:
        now = (time.perf_counter(), moment.steps)
        if moment.evaluation is not None:
            score, mean = moment.evaluation.score, moment.evaluation.mean
            self.score = f"return {mean:,.1f}" if score is None else f"score {score:.3f}"
        parts = [self.what, f"{moment.steps:,} steps", self.score]
        if moment.iteration is not None:
            did = moment.iteration
            parts += [f"η {did.eta:.3f}", f"D {did.accuracy:.2f}", f"KL {did.kl:.4f}"]
        if self.clock is not None:
            seconds, steps = now[0] - self.clock[0], now[1] - self.clock[1]
            parts.append(f"{steps / seconds:,.0f} steps/s")
        else:
            self.clock = now
        return "  ".join(filter(None, parts))


@contextmanager
def tensorboard(folder: Path, seen: Callback) -> Iterator[Callback]:
    """Also write every figure as a TensorBoard event into the folder, which the first one makes."""
    with ExitStack() as at_the_end:
        opened: list[SummaryWriter] = []

        def both(moment: HistoryRow) -> None:
            seen(moment)
            if not opened:
                opened.append(at_the_end.enter_context(closing(_writer(folder))))
            for name, value in moment.row().items():
                if value is not None and name not in ("steps", "number"):
                    opened[0].add_scalar(name, value, moment.steps)

        yield both


def _writer(folder: Path) -> SummaryWriter:
    from torch.utils.tensorboard.writer import SummaryWriter

    return SummaryWriter(str(folder))
