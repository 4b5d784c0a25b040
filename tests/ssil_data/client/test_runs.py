"""Runs of a service are the local records."""

import httpx
import pytest
from numpy.testing import assert_array_equal

import ssil_data as sd
from ssil_data.client import RemoteDataset
from support.scripted_service import scripted_store


def test_runs_are_the_local_records(dataset: RemoteDataset, local: sd.Store):
    here = local["drives"]
    assert [run.name for run in dataset.runs] == [run.name for run in here.runs]
    assert dataset.runs["mdn"] == here.runs["mdn"]
    assert dataset.runs.values("mdn").equals(here.runs.values("mdn"))
    assert_array_equal(dataset.leverage("mdn"), here.leverage("mdn"))
    with pytest.raises(sd.NotFoundError):
        dataset.runs["nope"]


@pytest.mark.parametrize("name", ["mdn?", "mdn#x", "..", "../../drives", "a/b", "", "mdn%2e"])
def test_a_name_that_no_run_can_have_is_refused_as_locally(
    name: str, dataset: RemoteDataset, local: sd.Store
):
    here = local["drives"]
    for ask in ("values", "of_any_version", "__getitem__"):
        with pytest.raises(sd.InvalidInputError) as expected:
            getattr(here.runs, ask)(name)
        with pytest.raises(sd.InvalidInputError) as found:
            getattr(dataset.runs, ask)(name)
        assert str(found.value) == str(expected.value)
    for ask in ("leverage", "field", "model"):
        with pytest.raises(sd.InvalidInputError, match="run name"):
            getattr(dataset, ask)(name)


def test_what_a_newer_service_adds_to_a_record_is_left_out(local: sd.Store):
    record = local["drives"].runs["mdn"]
    newer = {**record.to_json(), "mood": "good"}
    summary = {"dataset": "drives", "version": record.dataset_version, "pairs": 420}
    answers = [httpx.Response(200, json=found) for found in (newer, {"runs": [newer]})]
    store, _ = scripted_store(*answers)
    runs = RemoteDataset(store.connection, summary, {}).runs
    assert runs["mdn"] == record
    assert runs.all() == [record]


def test_a_record_of_an_earlier_service_has_fewer_keys(local: sd.Store):
    record = local["drives"].runs["mdn"]
    later = ("pooling", "fitted_pooling", "scale_floor", "cross_fit", "self_training", "weak")
    older = {name: value for name, value in record.to_json().items() if name not in later}
    store, _ = scripted_store(httpx.Response(200, json=older))
    summary = {"dataset": "drives", "version": record.dataset_version, "pairs": 420}
    assert RemoteDataset(store.connection, summary, {}).runs["mdn"] == record
