"""Runs whose uncertainty is pooled over time: their columns, their models, and older clients."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pyarrow as pa
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import ssil_data as sd
from ssil_data.client.wire import ARROW, decode, encode, pairs_table
from ssil_data.store.arrow_schema import FIRST_COLUMNS, VALUES
from ssil_service import embed
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives

RUN = "v1/datasets/drives/runs/pooled"
MODEL = "v2/models/drives.pooled"
RECIPE = sd.Recipe(
    sd.Ensemble((sd.VAE(steps=10), sd.MDN(steps=10))), sd.Posterior(), pooling=sd.Window(3)
)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> sd.Dataset:
    folder = tmp_path_factory.mktemp("pooled") / "store"
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    dataset = sd.Store(folder).create("drives", drives(), **names)
    sd.score(dataset, RECIPE, run="pooled")
    sd.score(dataset, sd.VAE(steps=10), run="single")
    return dataset


@pytest.fixture(scope="module")
def http(dataset: sd.Dataset) -> Iterator[httpx.Client]:
    with embed(Path(dataset.folder.uri).parent, jobs=1) as store:
        yield store.connection.client


@pytest.fixture
def pairs() -> sd.Pairs:
    """Two drives that the run has not seen."""
    drives = [drive(77, 9), drive(78, 6, spread=9)]
    return sd.Pairs(
        np.concatenate([each.states for each in drives]),
        np.concatenate([each.actions for each in drives]),
        np.repeat([4, 2], [9, 6]),
        np.concatenate([np.arange(9), np.arange(6)]),
    )


def arrow(http: httpx.Client, path: str, **request: object) -> pa.Table:
    answer = http.request("GET", path, headers={"Accept": ARROW}, **request)  # pyright: ignore
    assert answer.status_code == 200, answer.text
    return decode(answer.content).replace_schema_metadata(None)


def test_columns_that_came_later_are_given_if_they_are_named(
    http: httpx.Client, dataset: sd.Dataset
):
    expected = dataset.runs.values("pooled")
    found = arrow(http, f"{RUN}/leverage", params={"columns": VALUES.names})
    assert found.cast(VALUES).equals(expected)
    assert [name for name in VALUES.names if found[name].null_count] == [
        *("aleatoric", "epistemic", "windowvae", "gpr", "contrast")
    ]
    assert not np.array_equal(found["pooled"], found["uncertainty"])
    answer = http.get(f"{RUN}/leverage", params={"columns": ["pooled", "gpr"], "limit": 2}).json()
    assert_array_equal(answer["pooled"], expected["pooled"][:2])
    assert answer["gpr"] == [None, None]


def test_a_client_of_the_first_version_gets_the_columns_that_it_knows(
    http: httpx.Client, dataset: sd.Dataset
):
    first = pa.schema([VALUES.field(name) for name in FIRST_COLUMNS])
    found = arrow(http, f"{RUN}/leverage").cast(first)  # as that client does
    assert found.equals(dataset.runs.values("pooled").select(first.names))


def test_a_column_that_is_none_is_refused_by_its_name(http: httpx.Client):
    answer = http.get(f"{RUN}/leverage", params={"columns": "median"})
    assert answer.status_code == 422
    assert "columns" in answer.json()["detail"]


def test_a_record_tells_how_good_the_run_is(http: httpx.Client, dataset: sd.Dataset):
    record = http.get(RUN).json()
    assert sd.Run.from_json(record) == dataset.runs["pooled"]
    assert record["pooling"] == {"kind": "window", "half_width": 3}
    assert 0 < record["expert_share"] < 1
    low, high = record["expert_share_interval"]
    assert low <= record["expert_share"] <= high
    assert record["effective_pairs"] > 0
    assert isinstance(record["weak"], list)
    single = http.get("v1/datasets/drives/runs/single").json()
    assert (single["pooling"], single["expert_share"]) == ({"kind": "none"}, None)


def test_new_pairs_are_pooled_inside_the_episodes_of_a_request(
    http: httpx.Client, dataset: sd.Dataset, pairs: sd.Pairs
):
    expected = dataset.model("pooled")(pairs)
    body = {name: getattr(pairs, name).tolist() for name in ("states", "actions", "episode")}
    answer = http.post(f"{RUN}/score", json=body).json()
    for name in ("uncertainty", "leverage", "pooled"):
        assert_array_equal(answer[name], getattr(expected, name))
    for member in ("vae", "mdn"):
        assert_array_equal(answer[member], expected.parts[member])
    headers = {"Content-Type": ARROW, "Accept": ARROW}
    content = encode(pairs_table(pairs)).to_pybytes()
    found = decode(http.post(f"{RUN}/score", content=content, headers=headers).content)
    assert_array_equal(found["pooled"], expected.pooled)
    assert found.column_names[:4] == ["uncertainty", "aleatoric", "epistemic", "leverage"]


def test_a_pair_that_comes_alone_is_judged_alone(
    http: httpx.Client, dataset: sd.Dataset, pairs: sd.Pairs
):
    rows = range(len(pairs))
    states, actions = pairs.states.tolist(), pairs.actions.tolist()
    each = {"states": states, "actions": actions, "episode": list(rows), "step": [0] * len(pairs)}
    together = http.post(f"{RUN}/score", json=each).json()
    bodies = [{"states": [states[row]], "actions": [actions[row]]} for row in rows]
    alone = [http.post(f"{RUN}/score", json=body).json() for body in bodies]
    # networks multiply one row otherwise than many: the last digits differ
    assert_allclose([each["pooled"][0] for each in alone], together["pooled"], atol=1e-5)
    assert_allclose([each["leverage"][0] for each in alone], together["leverage"], atol=1e-4)
    one_drive = http.post(f"{RUN}/score", json={"states": states, "actions": actions}).json()
    assert_array_equal(one_drive["uncertainty"], together["uncertainty"])
    assert np.abs(np.subtract(one_drive["pooled"], together["pooled"])).max() > 0.1


def test_without_pooling_pooled_is_the_uncertainty(http: httpx.Client, pairs: sd.Pairs):
    body = {"states": pairs.states.tolist(), "actions": pairs.actions.tolist()}
    answer = http.post("v1/datasets/drives/runs/single/score", json=body).json()
    assert answer["pooled"] == answer["uncertainty"]
    assert "mdn" not in answer


def test_the_inference_protocol_gives_what_is_pooled_as_well(
    http: httpx.Client, dataset: sd.Dataset, pairs: sd.Pairs
):
    described = http.get(MODEL).json()["outputs"]
    assert [each["name"] for each in described] == ["uncertainty", "leverage", "pooled"]
    inputs = [
        {"name": name, "shape": list(values.shape), "datatype": kind, "data": values.tolist()}
        for name, values, kind in (
            ("states", pairs.states, "FP32"),
            ("actions", pairs.actions, "FP32"),
            ("episode", pairs.episode, "INT64"),
        )
    ]
    expected = dataset.model("pooled")(pairs)
    answer = http.post(f"{MODEL}/infer", json={"inputs": inputs}).json()
    outputs = {each["name"]: each["data"] for each in answer["outputs"]}
    for name in ("uncertainty", "leverage", "pooled"):
        assert_array_equal(outputs[name], getattr(expected, name))
    wanted = {"inputs": inputs, "outputs": [{"name": "pooled"}]}
    (only,) = http.post(f"{MODEL}/infer", json=wanted).json()["outputs"]
    assert only["data"] == outputs["pooled"]
