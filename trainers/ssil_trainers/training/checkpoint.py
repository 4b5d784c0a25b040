"""The checkpoint of a training run: written between iterations, and read to go on from there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ssil_data.errors import ConflictError
from ssil_trainers.algorithms import tensor_file
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.learner import Learner
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.algorithms.rewards import no_shaping
from ssil_trainers.training.history import HistoryRow

KIND = "ssil checkpoint"
"""What a checkpoint says that it is."""
CHECKPOINT = "checkpoint.safetensors"

STORED_NAMES = {"centered": "centred"}
"""Settings that policies and checkpoints keep under another name, that of their first version."""


def write_checkpoint(
    folder: Path, learner: Learner, *, identity: Mapping[str, Any], curve: Sequence[HistoryRow]
) -> None:
    """Write everything from which the next iteration can be resumed.

    Parameters
    ----------
    folder:
        Where the run keeps its files.
    learner:
        Between two iterations.
    identity:
        What the run was made from, as JSON; only the same run may go on.
    curve:
        The learning curve so far.
    """
    metadata = {
        "kind": KIND,
        "identity": identity,
        "done": learner.done,
        "eta": learner.eta,
        "curve": [asdict(row) for row in curve],
    }
    tensor_file.write(folder / CHECKPOINT, learner.arrays(), metadata)


def read_checkpoint(
    folder: Path, *, identity: Mapping[str, Any]
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Read the learner's arrays and the metadata of a checkpoint.

    Parameters
    ----------
    folder:
        Where the run keeps its files.
    identity:
        What this run is made from.

    Raises
    ------
    ConflictError
        If the checkpoint is another run's; it names what differs. Also for one of version 0.1 by a
        method that imitates by weight: its batches were drawn in another way; and for one with a
        centered state reward: its η followed another rule.
    """
    arrays, metadata = tensor_file.read(folder / CHECKPOINT, KIND)
    _check_same_run(_complete_settings(metadata["identity"]), identity)
    return arrays, metadata


def read_settings(folder: Path) -> dict[str, Any]:
    """Read the settings that a checkpoint's run was made with, by the names in `TrainSettings`.

    Parameters
    ----------
    folder:
        Where the run keeps its files.
    """
    _, metadata = tensor_file.read(folder / CHECKPOINT, KIND)
    names = {stored: name for name, stored in STORED_NAMES.items()}
    settings: Mapping[str, Any] = metadata["identity"]["settings"]
    return {names.get(stored, stored): value for stored, value in settings.items()}


def _complete_settings(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Give a checkpoint of an earlier version the defaults of the settings that it lacks."""
    by_weight = [name for name, method in METHODS.items() if method.half_labeled]
    if identity["method"] in by_weight and "expert_weighting" not in identity["settings"]:
        raise ConflictError(
            f"checkpoint: {identity['method']} of version 0.1 drew whole batches by leverage, and "
            "now half of each is labeled; another folder takes a new run"
        )
    shaped = METHODS[identity["method"]].shaping is not no_shaping
    if shaped and identity["settings"]["centred"] and "cor_alpha" not in identity["settings"]:
        raise ConflictError(
            f"checkpoint: {identity['method']} of version 0.1 judged η by the centered state "
            "reward, and now by the one before centering; another folder takes a new run"
        )
    defaults = {
        STORED_NAMES.get(name, name): value
        for name, value in asdict(TrainSettings()).items()
        if name != "steps"
    }
    return {**identity, "settings": {**defaults, **identity["settings"]}}


def _check_same_run(kept: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    """Raise ConflictError that names what differs between a checkpoint's run and this one."""
    for name, value in given.items():
        if kept[name] != value:
            raise ConflictError(f"checkpoint: expected {_list_differences(kept[name], value)}")


def _list_differences(kept: Any, given: Any) -> str:
    """Say which of two JSON values differ, key by key where they are objects."""
    if not (isinstance(kept, dict) and isinstance(given, dict)):
        return f"{kept!r} as before, found {given!r}"
    names = [name for name in {**kept, **given} if kept.get(name) != given.get(name)]
    return "; ".join(
        f"{name} {kept.get(name)!r} as before, found {given.get(name)!r}" for name in names
    )
