"""Scoring jobs of a service: made once, waited for, and failing as scoring does."""

import json
from pathlib import Path

import httpx
import pytest
from numpy.testing import assert_array_equal

import ssil_data as sd
from ssil_data.client import RemoteDataset, RemoteStore
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives
from support.scripted_service import scripted_store


def test_a_run_is_made_as_locally_and_reports_its_progress(remote: RemoteStore, tmp_path: Path):
    told: list[tuple[str, int, int]] = []
    made = remote["drives"].score(
        sd.Recipe(sd.VAE(steps=20), sd.MinMax()), seed=5, progress=lambda *step: told.append(step)
    )
    twin = sd.Store(tmp_path).create(
        "drives", drives(), state_names=STATE_NAMES, action_names=ACTION_NAMES
    )
    expected = sd.score(twin, sd.Recipe(sd.VAE(steps=20), sd.MinMax()), seed=5)
    assert_array_equal(remote["drives"].leverage(made.name), twin.leverage(expected.name))
    assert (made.seed, made.scale, made.model) == (5, expected.scale, expected.model)
    assert told[-1] == ("score", 420, 420)
    again = remote["drives"].rescore(remote["drives"], made.name, run="again")
    assert again.model == made.model


def test_a_failed_job_raises_what_scoring_raises(remote: RemoteStore):
    unlabeled = [drive(1, 20), drive(2, 20)]
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    dataset = remote.create("unlabeled", unlabeled, **names)
    with pytest.raises(sd.InvalidInputError, match="labeled"):
        dataset.score(sd.VAE())
    remote.delete("unlabeled")
    assert "unlabeled" not in remote


def test_a_job_is_made_once_however_often_the_request_is_sent():
    limits = {"query_rows": 10}
    summary = {"dataset": "drives", "version": "0" * 16, "pairs": 1}
    lost = httpx.RemoteProtocolError("hung up")
    accepted = httpx.Response(202, json={"job": "1"})
    store, seen = scripted_store(lost, accepted)
    RemoteDataset(store.connection, summary, limits).start({"estimator": {"kind": "vae"}})
    keys = [request.headers["idempotency-key"] for request in seen]
    assert len(keys) == 2 and keys[0] == keys[1]
    assert json.loads(seen[1].content)["version"] == "0" * 16


def test_without_a_recipe_this_versions_default_is_sent_whole():
    summary = {"dataset": "drives", "version": "0" * 16, "pairs": 1}
    answers = [httpx.Response(202, json={"job": "1"}), httpx.Response(404, json={"title": "none"})]
    store, seen = scripted_store(*answers)
    with pytest.raises(sd.NotFoundError):
        RemoteDataset(store.connection, summary, {}).score(labels=50, seed=7)
    sent = json.loads(seen[0].content)
    assert sd.Recipe.from_json(sent) == sd.preset("default")
    assert (sent["labels"], sent["seed"], "run" in sent) == (50, 7, False)
