"""The Open Inference Protocol: what stock clients of KServe and Triton send is answered."""

import json

import httpx
import numpy as np
import pytest
from numpy.testing import assert_array_equal

import ssil_data as sd
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives

LCOR = "v2/models/drives.vae.lcor"


@pytest.fixture
def dataset(scored) -> sd.Dataset:
    return sd.Store(scored)["drives"]


def tensor(name: str, values: np.ndarray, datatype: str = "FP32") -> dict:
    data = values.reshape(-1).tolist()
    return {"name": name, "shape": list(values.shape), "datatype": datatype, "data": data}


def test_server_and_models_describe_themselves(shared_http: httpx.Client, dataset: sd.Dataset):
    assert shared_http.get("v2/health/live").json()["live"] is True
    assert shared_http.get("v2/health/ready").json()["ready"] is True
    assert shared_http.get("v2").json()["extensions"] == ["binary_tensor_data"]
    found = shared_http.get(LCOR).json()
    assert found["versions"] == [dataset.version]
    assert found["inputs"] == [{"name": "states", "datatype": "FP32", "shape": [-1, 3]}]
    assert shared_http.get(f"{LCOR}/versions/{dataset.version}/ready").status_code == 200
    names = [each["name"] for each in shared_http.get("v2/models/drives.vae").json()["outputs"]]
    assert names == ["uncertainty", "leverage", "pooled"]


def test_json_tensors_are_answered(
    shared_http: httpx.Client, dataset: sd.Dataset, states: np.ndarray
):
    body = {"id": "7", "inputs": [tensor("states", states)]}
    answer = shared_http.post(f"{LCOR}/infer", json=body).json()
    assert (answer["model_name"], answer["id"]) == ("drives.vae.lcor", "7")
    outputs = {each["name"]: each["data"] for each in answer["outputs"]}
    expected = dataset.field("vae").lcor(states)
    assert_array_equal(outputs["values"], expected.values)
    assert_array_equal(outputs["effective_sample_size"], expected.effective_sample_size)
    nested = {"inputs": [{**tensor("states", states), "data": states.tolist()}]}
    again = shared_http.post(f"{LCOR}/infer", json=nested).json()
    assert again["outputs"] == answer["outputs"]
    cor = shared_http.post("v2/models/drives.vae.cor/infer", json=body).json()["outputs"]
    assert_array_equal(cor[0]["data"], dataset.field("vae").cor(states))


def test_binary_tensors_are_answered_as_triton_sends_them(
    shared_http: httpx.Client, dataset: sd.Dataset, states: np.ndarray
):
    data = states.tobytes()
    header = json.dumps(
        {
            "inputs": [
                {
                    "name": "states",
                    "shape": list(states.shape),
                    "datatype": "FP32",
                    "parameters": {"binary_data_size": len(data)},
                }
            ],
            "outputs": [{"name": "values", "parameters": {"binary_data": True}}],
        }
    ).encode()
    headers = {
        "Inference-Header-Content-Length": str(len(header)),
        "Content-Type": "application/octet-stream",
    }
    answer = shared_http.post(f"{LCOR}/infer", content=header + data, headers=headers)
    assert answer.status_code == 200, answer.text
    length = int(answer.headers["inference-header-content-length"])
    (output,) = json.loads(answer.content[:length])["outputs"]
    values = np.frombuffer(answer.content[length:], "<f8")
    assert output["parameters"]["binary_data_size"] == values.nbytes
    assert_array_equal(values, dataset.field("vae").lcor(states).values)


def test_an_estimator_scores_pairs(shared_http: httpx.Client, dataset: sd.Dataset):
    pairs = dataset.episode(2)
    inputs = [tensor("states", pairs.states), tensor("actions", pairs.actions)]
    inputs.append(tensor("episode", pairs.episode, "INT64"))
    answer = shared_http.post("v2/models/drives.vae/infer", json={"inputs": inputs}).json()
    outputs = {each["name"]: each["data"] for each in answer["outputs"]}
    expected = dataset.model("vae")(pairs)
    assert_array_equal(outputs["leverage"], expected.leverage)
    assert_array_equal(outputs["uncertainty"], expected.uncertainty)


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"shape": [1, 4]}, 422),
        ({"shape": [-1, -3]}, 422),
        ({"shape": [2**62, 2**62]}, 422),
        ({"datatype": "BYTES"}, 422),
        ({"name": "other"}, 422),
        ({"data": ["1", 2, 3]}, 422),
        ({"data": [1e300, 2, 3]}, 422),
        ({"data": [10**400, 2, 3]}, 422),
        ({"data": None}, 422),
        ({"data": [True, 2, 3]}, 422),
        ({"data": [[1.0, 2.0], [3.0]]}, 422),
        ({"data": [[1.0, 2.0, 3.0], 4.0]}, 422),
        ({"parameters": {"binary_data_size": 12}}, 422),
    ],
)
def test_invalid_tensors_are_refused_with_the_protocols_error_field(
    change: dict, status: int, shared_http: httpx.Client
):
    given = {"name": "states", "shape": [1, 3], "datatype": "FP32", "data": [1.0, 2.0, 3.0]}
    answer = shared_http.post(f"{LCOR}/infer", json={"inputs": [{**given, **change}]})
    assert answer.status_code == status
    assert answer.json()["error"] == answer.json()["detail"]


@pytest.mark.parametrize(
    "name", ["drives", "drives.nope", "nope.vae", "vae.drives", "drives.vae.x"]
)
def test_an_unknown_model_or_version_is_not_found(name: str, shared_http: httpx.Client):
    assert shared_http.get(f"v2/models/{name}").status_code == 404
    assert shared_http.get(f"{LCOR}/versions/{'0' * 16}/ready").status_code == 404


def test_a_named_version_is_answered_after_the_dataset_has_grown(
    http: httpx.Client, local: sd.Store, states: np.ndarray
):
    before, body = local["drives"], {"inputs": [tensor("states", states)]}
    before.append([drive(9, 50)])
    pinned = f"{LCOR}/versions/{before.version}"
    assert http.get(pinned).json()["versions"] == [before.version]
    answer = http.post(f"{pinned}/infer", json=body).json()
    assert answer["model_version"] == before.version
    assert_array_equal(answer["outputs"][0]["data"], before.field("vae").lcor(states).values)
    for path in (LCOR, f"{LCOR}/ready"):
        assert http.get(path).status_code == 409
    assert http.post(f"{LCOR}/infer", json=body).status_code == 409
    assert http.get("v2/models/drives.vae/ready").status_code == 200  # a model scores any pairs
    newest = local["drives"].version
    assert http.get(f"{LCOR}/versions/{newest}").status_code == 404


def test_an_ambiguous_name_is_refused_unless_its_version_decides(
    http: httpx.Client, local: sd.Store
):
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    quick = sd.VAE(steps=2)
    one = local.create("a", drives(), **names)
    other = local.create("a.b", drives()[:-1], **names)
    for dataset, run in ((one, "b.c"), (other, "c"), (one, "r"), (one, "r.lcor"), (one, "x.cor")):
        sd.score(dataset, quick, run=run)
    for name, meanings in (
        ("a.b.c", "run b.c of a and run c of a.b"),
        ("a.b.c.cor", "run b.c of a and run c of a.b"),
        ("a.r.lcor", "run r of a and run r.lcor of a"),
    ):
        answer = http.get(f"v2/models/{name}")
        assert answer.status_code == 409
        assert answer.json()["error"] == f"model: the name may mean {meanings}; name a version"
    for dataset in (one, other):
        path = f"v2/models/a.b.c/versions/{dataset.version}"
        assert http.get(path).json()["versions"] == [dataset.version]
    assert http.get(f"v2/models/a.r.lcor/versions/{one.version}").status_code == 409
    found = http.get("v2/models/a.x.cor").json()
    assert [each["name"] for each in found["outputs"]] == ["uncertainty", "leverage", "pooled"]


@pytest.mark.parametrize("size", ["9" * 3000, "9" * 9000, str(2**41), "-1"], ids=len)
def test_a_huge_shape_is_refused_without_an_echo(size: str, shared_http: httpx.Client):
    tensor = f'{{"name": "states", "shape": [1, {size}], "datatype": "FP32", "data": [1]}}'
    headers = {"Content-Type": "application/json"}
    content = f'{{"inputs": [{tensor}]}}'
    answer = shared_http.post(f"{LCOR}/infer", content=content, headers=headers)
    assert answer.status_code == 422
    assert len(answer.content) < 600


@pytest.mark.parametrize("number", [2**63, 2**64 + 1, -(2**63) - 1, True, 1.0])
def test_integers_are_not_wrapped(number: object, shared_http: httpx.Client):
    inputs = [
        {"name": "states", "shape": [1, 3], "datatype": "FP32", "data": [1, 2, 3]},
        {"name": "actions", "shape": [1, 2], "datatype": "FP32", "data": [1, 2]},
        {"name": "episode", "shape": [1], "datatype": "INT64", "data": [number]},
    ]
    assert (
        shared_http.post("v2/models/drives.vae/infer", json={"inputs": inputs}).status_code == 422
    )
