"""Bodies made to cost much more than their length: refused early, with a hundred faults at most."""

import json
import resource
import threading
import time
from pathlib import Path

import httpx
import numpy as np
import pyarrow as pa
import pytest

from ssil_data.client.wire import ARROW, JSON, encode, rows_of_matrix
from ssil_service import embed

LCOR = "v1/datasets/drives/runs/vae/lcor"
SCORE = "v1/datasets/drives/runs/vae/score"
RUNS = "v1/datasets/drives/runs"
INFER = "v2/models/drives.vae.lcor/infer"
MIB = 2**20


def post_json(http: httpx.Client, path: str, body: bytes) -> httpx.Response:
    return http.post(path, content=body, headers={"Content-Type": JSON})


def peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


def many(part: bytes, size: int = 3_900_000) -> bytes:
    return b",".join([part] * (size // (len(part) + 1)))


TENSOR = b'{"inputs":[{"name":"states","shape":[1,3],"datatype":"FP32","data":[%s]}]}'
BOMBS = {
    "wrong cells": (LCOR, b'{"states":[[%s]]}' % many(b'""')),
    "rows of wrong cells": (LCOR, b'{"states":[%s]}' % many(b"[0,{},0]", 500_000)),
    "empty rows": (LCOR, b'{"states":[%s]}' % many(b"[]", 150_000)),
    "odd integers": (
        SCORE,
        b'{"states":[],"actions":[],"episode":[%s]}' % many(b'""'),
    ),
    "unknown names": (
        LCOR,
        b"{%s}" % b",".join(b'"%d":0' % number for number in range(400_000)),
    ),
    "settings": (RUNS, b"{%s}" % b",".join(b'"%d":0' % number for number in range(400_000))),
    "text in a tensor": (INFER, TENSOR % (b'"' + b"x" * 10**6 + b'",' + many(b'""', 10**6))),
    "objects in a tensor": (INFER, TENSOR % many(b"{}")),
    "outputs": (INFER, b'{"inputs":[],"outputs":[%s]}' % many(b"{}")),
    "shape": (INFER, TENSOR.replace(b"[1,3]", b"[%s]" % many(b'""')) % b""),
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_body_full_of_mistakes_costs_little_and_delays_no_other_request(
    name: str, shared_http: httpx.Client
):
    path, body = BOMBS[name]
    post_json(shared_http, LCOR, b'{"states":[[1,2,3]]}')
    before = peak()
    longest = [0.0]
    over = threading.Event()

    def watch() -> None:
        while not over.is_set():
            begin = time.perf_counter()
            shared_http.get("healthz")
            longest[0] = max(longest[0], time.perf_counter() - begin)

    watcher = threading.Thread(target=watch)
    watcher.start()
    answer = post_json(shared_http, path, body)
    over.set()
    watcher.join()
    assert answer.status_code in (413, 422), answer.text[:200]
    assert len(answer.json().get("errors", [])) <= 100
    assert peak() - before < 400
    assert longest[0] < 3  # with every cell decoded it was nine seconds


def test_a_hundred_arrow_cells_without_a_number_are_named_at_most(shared_http: httpx.Client):
    table = pa.table({"state": rows_of_matrix(np.full((65_536, 3), np.nan, np.float32))})
    headers = {"Content-Type": ARROW}
    answer = shared_http.post(LCOR, content=encode(table).to_pybytes(), headers=headers)
    assert (answer.status_code, len(answer.json()["errors"])) == (422, 100)


def test_json_has_a_smaller_limit_than_other_bodies_which_the_limits_show(folder: Path):
    with embed(folder, json_bytes=2000) as store:
        http = store.connection.client
        limits = http.get("v1/limits").json()
        assert (limits["json_bytes"], limits["run_bytes"]) == (2000, 65_536)
        large = json.dumps({"states": [[1.0, 2.0, 3.0]] * 200}).encode()
        assert post_json(http, LCOR, large).status_code == 413
        assert post_json(http, LCOR, large[:1000]).status_code == 422
        table = pa.table({"state": rows_of_matrix(np.ones((200, 3), np.float32))})
        content, headers = encode(table).to_pybytes(), {"Content-Type": ARROW}
        assert len(content) > 2000
        assert http.post(LCOR, content=content, headers=headers).status_code == 200
        before = {"Inference-Header-Content-Length": str(len(large))}
        binary = {**before, "Content-Type": "application/octet-stream"}
        assert http.post(INFER, content=large, headers=binary).status_code == 413


def test_contributors_of_too_many_rows_are_refused(shared_http: httpx.Client):
    table = pa.table({"state": rows_of_matrix(np.ones((60_000, 3), np.float32))})
    headers = {"Content-Type": ARROW, "Accept": JSON}
    content = encode(table).to_pybytes()
    answer = shared_http.post(LCOR, params={"contributors": 256}, content=content, headers=headers)
    assert answer.status_code == 413
