"""Requests as the stock clients of Triton and KServe send them, byte for byte."""

import json
from pathlib import Path

import httpx
import numpy as np
import pytest
from numpy.testing import assert_array_equal

import ssil_data as sd


@pytest.mark.parametrize(
    "named",
    [
        {},  # tritonclient.http
        {"Content-Type": "application/octet-stream"},  # tritonclient.http.aio, kserve
    ],
)
def test_binary_tensors_are_answered_whatever_the_content_type(
    named: dict[str, str], shared_http: httpx.Client, scored: Path, states: np.ndarray
):
    size = {"binary_data_size": states.nbytes}
    tensor = {"name": "states", "shape": list(states.shape), "datatype": "FP32"}
    head = json.dumps(
        {
            "inputs": [{**tensor, "parameters": size}],
            "parameters": {"binary_data_output": True},
        },
        separators=(",", ":"),
    ).encode()
    length = {"Inference-Header-Content-Length": str(len(head))}
    answer = shared_http.post(
        "v2/models/drives.vae.lcor/infer",
        content=head + states.tobytes(),
        headers={**named, **length},
    )
    assert answer.status_code == 200, answer.text
    cut = int(answer.headers["Inference-Header-Content-Length"])
    about = json.loads(answer.content[:cut])["outputs"][0]
    count = about["parameters"]["binary_data_size"]
    values = np.frombuffer(answer.content[cut : cut + count], "<f8")
    assert_array_equal(values, sd.Store(scored)["drives"].field("vae").lcor(states).values)


def test_json_tensors_without_a_content_type_are_answered(
    shared_http: httpx.Client, states: np.ndarray
):
    tensor = {"name": "states", "shape": list(states.shape), "datatype": "FP32"}
    body = json.dumps({"inputs": [{**tensor, "data": states.ravel().tolist()}]}).encode()
    answer = shared_http.post("v2/models/drives.vae.lcor/infer", content=body)
    assert answer.status_code == 200, answer.text
