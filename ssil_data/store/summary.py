"""A dataset in one line: the summary that the command prints and the service serves."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypedDict

from ssil_data.store.dataset import Dataset


class DatasetSummary(TypedDict):
    """One version of a dataset; `labeled` counts pairs, `runs` are those of all versions."""

    dataset: str
    version: str
    pairs: int
    episodes: int
    labeled: int
    state_names: list[str]
    action_names: list[str]
    runs: list[str]


def summarize(dataset: Dataset, runs: Iterable[str] | None = None) -> DatasetSummary:
    """Return the summary of one version of a dataset.

    Parameters
    ----------
    dataset
        The opened version.
    runs
        The names of its runs, if they are known; read without.

    Examples
    --------
    >>> from ssil_data.store.summary import summarize
    >>> summary = summarize(dataset)
    >>> summary["pairs"] == len(dataset), summary["runs"]
    (True, ['vae'])
    """
    return {
        "dataset": dataset.name,
        "version": dataset.version,
        "pairs": len(dataset),
        "episodes": len(dataset.episodes),
        "labeled": int(dataset.per_pair("labeled").sum()),
        "state_names": dataset.state_names,
        "action_names": dataset.action_names,
        "runs": sorted(dataset.runs.names() if runs is None else runs),
    }
