"""What a training run shows while it goes on."""

from __future__ import annotations

from pathlib import Path

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from ssil_trainers.training.history import Evaluation, HistoryRow
from ssil_trainers.training.progress import tensorboard


def test_every_figure_of_a_run_is_a_tensorboard_event(tmp_path: Path) -> None:
    rows: list[HistoryRow] = []
    with tensorboard(tmp_path, rows.append) as callback:
        callback(HistoryRow(0, None, Evaluation(mean=-3.0, least=-4.0, length=20.0, score=0.5)))
    assert len(rows) == 1
    read = EventAccumulator(str(tmp_path))
    read.Reload()
    assert set(read.Tags()["scalars"]) == {"return_mean", "return_least", "return_length", "score"}
    assert read.Scalars("score")[0].value == 0.5
