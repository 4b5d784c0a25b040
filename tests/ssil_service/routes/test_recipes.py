"""Scoring jobs by recipe: whatever the library can do, with its numbers, and refusals by name."""

import shutil
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest
from pydantic import ValidationError

import ssil_data as sd
from ssil_data.client import RemoteStore
from ssil_service import embed
from ssil_service.jobs.runner import build_expected_record
from ssil_service.schemas.requests import FitBody
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive

NAMES = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
RUNS = "v1/datasets/drives/runs"
MEMBERS = [{"kind": "vae", "steps": 10}, {"kind": "contrast", "steps": 10}]
ENSEMBLE = sd.Ensemble((sd.VAE(steps=10), sd.Contrast(steps=10)))
FEW = [*[drive(seed, 12, labeled=True) for seed in range(3)], drive(7, 30), drive(8, 20, spread=9)]


@pytest.fixture(scope="module")
def folder(scored: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store for the tests here, each of which makes runs or datasets of names of its own."""
    return Path(shutil.copytree(scored, tmp_path_factory.mktemp("recipes") / "store"))


@pytest.fixture(scope="module")
def local(folder: Path) -> sd.Store:
    """The store on disk."""
    return sd.Store(folder)


@pytest.fixture(scope="module")
def remote(folder: Path) -> Iterator[RemoteStore]:
    """The same store through one service, whose worker needs to import torch only once."""
    with embed(folder, jobs=1) as store:
        yield store


@pytest.fixture(scope="module")
def http(remote: RemoteStore) -> httpx.Client:
    """Plain requests to that service."""
    return remote.connection.client


def ended(http: httpx.Client, answer: httpx.Response) -> dict[str, Any]:
    assert answer.status_code == 202, answer.text
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline:
        found = http.get(answer.headers["location"]).json()
        if found["state"] in ("succeeded", "failed", "cancelled"):
            return found
        time.sleep(0.05)
    raise TimeoutError(answer.headers["location"])


RECIPES: dict[str, tuple[dict[str, Any], sd.Recipe]] = {
    "an estimator alone goes with the quantile scale, as it always did": (
        {"estimator": {"kind": "vae", "steps": 10}},
        sd.Recipe(sd.VAE(steps=10)),
    ),
    "contrast, and a share that is known": (
        {
            "estimator": {"kind": "contrast", "steps": 10},
            "scale": {"kind": "posterior", "expert_share": 0.25},
        },
        sd.Recipe(sd.Contrast(steps=10), sd.Posterior(0.25)),
    ),
    "an ensemble of members, pooled by a hidden Markov model": (
        {
            "estimator": {"kind": "ensemble", "members": MEMBERS},
            "pooling": {"kind": "hmm", "bins": 8},
            "scale": {"kind": "posterior"},
        },
        sd.Recipe(ENSEMBLE, sd.Posterior(), pooling=sd.HiddenMarkov(bins=8)),
    ),
    "a window, a scale floor, cross-fitting and self-training": (
        {
            "estimator": {"kind": "ensemble", "members": MEMBERS},
            "pooling": {"kind": "window", "half_width": 5},
            "scale": {"kind": "posterior", "expert_share": None},
            "scale_floor": 0.3,
            "cross_fit": True,
            "self_training": True,
        },
        sd.Recipe(
            ENSEMBLE,
            sd.Posterior(),
            pooling=sd.Window(5),
            scale_floor=0.3,
            cross_fit=True,
            self_training=True,
        ),
    ),
}


@pytest.mark.parametrize("what", RECIPES)
def test_a_job_makes_the_run_that_the_library_makes(
    what: str, http: httpx.Client, local: sd.Store, tmp_path: Path
):
    body, recipe = RECIPES[what]
    name = f"new-{list(RECIPES).index(what)}"
    assert ended(http, http.post(RUNS, json={**body, "seed": 3, "run": name}))["error"] is None
    made = local["drives"].runs[name]
    twin = sd.Store(tmp_path / "twin").create("drives", _episodes(local), **NAMES)
    expected = sd.score(twin, recipe, seed=3, run=name)
    assert sd.Recipe.of_run(made) == recipe
    assert _without_times(made) == _without_times(expected)
    assert local["drives"].runs.values(name).equals(twin.runs.values(name))
    shown = sd.Run.from_json(http.get(f"{RUNS}/{name}").json())
    assert _without_times(shown) == _without_times(made)


def test_a_job_without_an_estimator_is_the_default_preset_byte_for_byte(
    remote: RemoteStore, local: sd.Store, tmp_path: Path
):
    http = remote.connection.client
    remote.create("few", FEW, **NAMES)
    done = ended(http, http.post("v1/datasets/few/runs", json={"seed": 5}))
    assert (done["run"], done["error"]) == ("ensemble", None)
    twin = sd.Store(tmp_path / "twin").create("few", FEW, **NAMES)
    expected = sd.score(twin, seed=5)
    made = local["few"].runs["ensemble"]
    assert made.preset == "default"
    assert _without_times(made) == _without_times(expected)
    assert local["few"].runs.values("ensemble").equals(twin.runs.values("ensemble"))
    assert local["few"].runs.model(made) == twin.runs.model(expected)


def test_without_an_estimator_each_key_replaces_a_choice_of_the_default_preset():
    default = sd.preset("default")
    assert FitBody.model_validate({}).recipe() == default
    assert FitBody.model_validate({"estimator": None, "scale": None}).recipe() == default
    body = {"scale": {"kind": "posterior", "expert_share": 0.4}, "cross_fit": False}
    given = FitBody.model_validate(body).recipe()
    assert given == replace(default, scale=sd.Posterior(0.4), cross_fit=False)
    assert (default.preset, given.preset) == ("default", None)


ODD = ["null", "[]", '"window"', "[{}]", "true", "1e400", "-1e400", "1" + "0" * 400, "1e39", "NaN"]
PLACES = [
    '{"scale": %s}',
    '{"pooling": %s}',
    '{"estimator": %s}',
    '{"scale": {"kind": %s}}',
    '{"scale": {"kind": "posterior", "expert_share": %s}}',
    '{"scale": {"kind": "quantile", "low": %s}}',
    '{"scale": {"kind": "conformal", "held_out": %s}}',
    '{"pooling": {"kind": "window", "half_width": %s}}',
    '{"pooling": {"kind": "hmm", "bins": %s}}',
    '{"pooling": {"kind": "hmm", "start_share": %s}}',
    '{"estimator": {"kind": "vae", "latent": %s}}',
    '{"estimator": {"kind": "vae", "beta": %s}}',
    '{"estimator": {"kind": "ensemble", "members": %s}}',
    '{"scale_floor": %s}',
    '{"seed": %s}',
]


@pytest.mark.parametrize("place", PLACES)
def test_an_odd_value_is_a_problem_of_the_request_or_a_recipe(
    place: str, shared_http: httpx.Client
):
    for value in ODD:
        # one label is refused too: no job begins, whatever the value
        body = place.replace("{", '{"labels": 1, ', 1) % value
        answer = shared_http.post(RUNS, content=body, headers={"Content-Type": "application/json"})
        kind = answer.headers["content-type"]
        assert (answer.status_code, kind) == (422, "application/problem+json"), value
        try:
            FitBody.model_validate_json(place % value).recipe()
        except (ValidationError, sd.InvalidInputError):
            continue
        assert value == "null", value


def test_what_a_client_sends_is_the_recipe_that_the_service_reads():
    for recipe in (*(recipe for _, recipe in RECIPES.values()), sd.preset("paper", "mdn")):
        assert FitBody.model_validate(recipe.to_json()).recipe() == recipe


VAE = {"kind": "vae", "steps": 10}
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "an unknown pooling": ({"estimator": VAE, "pooling": {"kind": "median"}}, "pooling"),
    "a pooling that is none": ({"estimator": VAE, "pooling": "window"}, "pooling"),
    "a window of nothing": (
        {"pooling": {"kind": "window", "half_width": 0}},
        "pooling.window.half_width",
    ),
    "a window of more than a drive": (
        {"pooling": {"kind": "window", "half_width": 100_001}},
        "pooling.window.half_width",
    ),
    "one bin": ({"pooling": {"kind": "hmm", "bins": 1}}, "pooling.hmm.bins"),
    "an expert share of another scale": (
        {"estimator": VAE, "scale": {"kind": "quantile", "expert_share": 0.2}},
        "scale.quantile.expert_share",
    ),
    "an expert share of no scale": ({"estimator": VAE, "expert_share": 0.2}, "expert_share"),
    "an expert share of all": (
        {"scale": {"kind": "posterior", "expert_share": 1}},
        "scale.posterior.expert_share",
    ),
    "one label": ({"estimator": VAE, "labels": 1}, "labels"),
    "a floor below zero": ({"estimator": VAE, "scale_floor": -0.1}, "scale_floor"),
    "a switch that is none": ({"estimator": VAE, "cross_fit": "yes"}, "cross_fit"),
    "self-training by number": ({"estimator": VAE, "self_training": 1}, "self_training"),
    "one member": (
        {"estimator": {"kind": "ensemble", "members": [VAE]}},
        "estimator.ensemble.members",
    ),
    "two members of a kind": ({"estimator": {"kind": "ensemble", "members": [VAE, VAE]}}, ""),
    "an ensemble in an ensemble": (
        {"estimator": {"kind": "ensemble", "members": [VAE, {"kind": "ensemble"}]}},
        "estimator.ensemble.members",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_recipe_that_is_none_is_a_problem_with_its_name_and_nothing_is_written(
    what: str, shared_http: httpx.Client
):
    body, field = WRONG[what]
    before = [shared_http.get(path).json() for path in (RUNS, "v1/jobs")]
    answer = shared_http.post(RUNS, json=body)
    assert (answer.status_code, answer.headers["content-type"]) == (422, "application/problem+json")
    named = [fault["field"] for fault in answer.json().get("errors", [])]
    assert named == [field] if field else "members of different kinds" in answer.json()["detail"]
    assert [shared_http.get(path).json() for path in (RUNS, "v1/jobs")] == before


def test_a_fully_labeled_dataset_is_one_problem_where_unlabeled_pairs_are_needed(
    remote: RemoteStore,
):
    http = remote.connection.client
    jobs = http.get("v1/jobs").json()
    remote.create("all", FEW[:3], **NAMES)
    contrast = {"estimator": {"kind": "contrast"}}
    posterior = {"estimator": VAE, "scale": {"kind": "posterior"}}
    for body in ({}, contrast, posterior):
        answer = http.post("v1/datasets/all/runs", json=body)
        assert answer.status_code == 422
        assert answer.json()["detail"].startswith("score: every pair is labeled")
    assert http.get("v1/datasets/all/runs").json() == {"runs": []}
    assert http.get("v1/jobs").json() == jobs
    conformal = {"estimator": VAE, "scale": {"kind": "conformal"}}
    assert ended(http, http.post("v1/datasets/all/runs", json=conformal))["state"] == "succeeded"


def test_a_job_may_rest_on_the_first_labeled_pairs_alone(remote: RemoteStore, local: sd.Store):
    http = remote.connection.client
    done = ended(http, http.post(RUNS, json={"estimator": VAE, "labels": 50, "run": "fewer"}))
    assert done["error"] is None
    expected = sd.score(local["drives"], sd.VAE(steps=10), labels=50)
    made = local["drives"].runs["fewer"]
    assert (made.labeled, made.model) == (50, expected.model)
    assert sd.score(remote["drives"], sd.VAE(steps=10), labels=50).model == expected.model
    more = http.post(RUNS, json={"estimator": VAE, "labels": 121})
    assert more.status_code == 422
    assert more.json()["detail"].startswith("labels: expected a whole number from 2 to 120")


def test_a_dataset_without_labels_is_one_problem(remote: RemoteStore):
    http = remote.connection.client
    jobs = http.get("v1/jobs").json()
    remote.create("none", FEW[3:], **NAMES)
    answer = http.post("v1/datasets/none/runs", json={})
    assert answer.status_code == 422
    assert answer.json()["detail"].startswith("labeled episodes of none")
    assert http.get("v1/jobs").json() == jobs


def test_a_job_that_an_earlier_version_accepted_is_told_by_what_it_has(local: sd.Store):
    old = {
        "estimator": {"kind": "vae", "steps": 20},
        "scale": {"kind": "quantile", "low": 0.05, "high": 0.95},
        "labeled_is_one": False,
        "seed": 0,
    }
    assert build_expected_record(old, local, "drives") == old
    new = {**old, "cross_fit": True, "labels": None}
    assert build_expected_record(new, local, "drives") == {**old, "cross_fit": True}
    fewer = build_expected_record({**new, "labels": 50}, local, "drives")
    assert fewer == {**old, "cross_fit": True, "labeled": 50}
    assert sd.Recipe.from_json(old) == sd.Recipe(sd.VAE(steps=20))


def _episodes(local: sd.Store) -> list[sd.Episode]:
    """The episodes of `drives`, to make a twin that nothing else has touched."""
    dataset = local["drives"]
    labeled = dataset.episodes["labeled"].to_pylist()
    pairs = [dataset.episode(number) for number in range(len(labeled))]
    return [
        sd.Episode(each.states, each.actions, is_labeled)
        for each, is_labeled in zip(pairs, labeled, strict=True)
    ]


def _without_times(run: sd.Run) -> dict[str, Any]:
    """What two runs of equal data must agree on; versions name tiers and sources as well."""
    left_out = {"created", "seconds", "dataset_version"}
    return {name: value for name, value in run.to_json().items() if name not in left_out}
