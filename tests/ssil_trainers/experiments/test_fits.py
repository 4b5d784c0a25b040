"""The working store: a copy for each version of a dataset, and made again if it was changed."""

from __future__ import annotations

from pathlib import Path

from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_trainers.experiments.fits import copy_dataset, limit_dataset
from support.demonstrations import drive


def test_a_working_copy_is_made_once_for_each_version(
    store: Store, dataset: Dataset, tmp_path: Path
) -> None:
    first = copy_dataset(store, "drives", tmp_path / "work")
    fewer = limit_dataset(first, "drives", 80)
    again = copy_dataset(store, "drives", tmp_path / "work")
    assert again.folder.uri == first.folder.uri and fewer in again
    appended = dataset.append([drive(9, 30)])
    other = copy_dataset(store, "drives", tmp_path / "work")
    assert other.folder.uri != first.folder.uri
    assert other["drives"].version == appended.version


def test_a_working_copy_that_was_changed_is_made_again(
    store: Store, dataset: Dataset, tmp_path: Path
) -> None:
    copy = copy_dataset(store, "drives", tmp_path / "work")
    copy["drives"].append([drive(9, 30)])
    assert copy["drives"].version != dataset.version
    again = copy_dataset(store, "drives", tmp_path / "work")
    assert again["drives"].version == dataset.version
