"""A run's values belong to the version that it was made from."""

from dataclasses import replace

import pytest

from ssil_data.errors import ConflictError
from ssil_data.estimators import VAE
from ssil_data.scoring import score
from ssil_data.store.dataset import Dataset
from ssil_data.store.version_rule import check_version, select_version


def test_a_run_of_the_version_is_returned_and_one_of_another_is_refused(dataset: Dataset):
    run = score(dataset, VAE(steps=2))
    assert check_version(run, dataset="drives", version=dataset.version) is run
    other = replace(run, dataset_version="0" * 16)
    message = (
        f"run 'vae': expected one made from version {dataset.version} of drives, found version 0000"
    )
    with pytest.raises(ConflictError, match=message):
        check_version(other, dataset="drives", version=dataset.version)
    assert select_version([other, run], dataset.version) == [run]
    assert select_version([other, run], "1" * 16) == []
