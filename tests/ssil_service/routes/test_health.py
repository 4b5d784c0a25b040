"""Operation: health, limits, metrics, logs, what the cache holds, what is seen without restart."""

import errno
import json
import re
import time
from pathlib import Path
from typing import Any

import httpx
import pytest

from ssil_service import embed
from ssil_service.server.launch import Server

LCOR = "v1/datasets/drives/runs/vae/lcor"
BODY = {"states": [[1.0, 2.0, 3.0]]}


def test_health_limits_and_metrics_are_answered(http: httpx.Client):
    assert http.get("healthz").json() == {"status": "ok"}
    assert http.get("readyz").json() == {"status": "ok"}
    limits = http.get("v1/limits").json()
    assert (limits["query_rows"], limits["batches"]) == (65_536, 4_096)
    http.post(LCOR, json=BODY)
    http.post(LCOR, json=BODY)
    text = http.get("metrics").text
    route = 'route="/v1/datasets/{dataset}/runs/{run}/lcor"'
    assert f'ssil_request_seconds_count{{method="POST",{route},status="200"}} 2.0' in text
    assert 'ssil_rows_total{route="lcor"} 2.0' in text
    assert "ssil_cache_hits_total 1.0" in text
    assert "# TYPE ssil_cache_hits_total counter" in text
    assert 'ssil_jobs{state="queued"} 0.0' in text


def test_unknown_methods_share_one_label(http: httpx.Client):
    for number in range(20):
        assert http.request(f"FOO{number}", "v1/datasets").status_code == 405
    text = http.get("metrics").text
    assert "FOO" not in text
    assert 'ssil_request_seconds_count{method="any",route="/v1/datasets",status="405"} 20.0' in text


def test_rows_of_the_inference_protocol_are_counted(http: httpx.Client):
    tensor = {"name": "states", "datatype": "FP32", "shape": [2, 3], "data": [1, 2, 3, 4, 5, 6]}
    assert http.post("v2/models/drives.vae.lcor/infer", json={"inputs": [tensor]}).is_success
    assert 'ssil_rows_total{route="infer"} 2.0' in http.get("metrics").text


@pytest.mark.parametrize(
    ("fault", "status"),
    [
        (RuntimeError("secret place"), 500),
        (OSError(errno.EIO, "secret place"), 500),
        (TimeoutError("secret place"), 500),
        (OSError(errno.ENOSPC, "secret place"), 507),
    ],
)
@pytest.mark.parametrize("path", ["v1/limits", "v2"])
def test_an_unexpected_error_is_a_problem(
    fault: Exception, status: int, path: str, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
):
    def fails(*_: object) -> None:
        raise fault

    monkeypatch.setattr("ssil_service.routes.health.context", fails)
    monkeypatch.setattr("ssil_service.routes.inference.version", fails)
    answer = http.get(path)
    assert (answer.status_code, answer.headers["content-type"]) == (
        status,
        "application/problem+json",
    )
    assert answer.json()["status"] == status
    assert "secret" not in answer.text


def test_a_client_that_disconnects_counts_as_499(raw: Any, server: Server):
    head = b"PUT /v1/datasets/cut HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9999\r\n"
    raw(head + b"Content-Type: application/vnd.apache.parquet\r\n\r\nhalf").close()
    found: list[str] = []
    for _ in range(100):
        text = httpx.get(f"{server.url}/metrics").text
        if found := re.findall(r'seconds_count{method="PUT",route="[^"]*",status="(\d+)"', text):
            break
        time.sleep(0.02)
    assert found == ["499"]


def test_a_request_id_is_kept_or_made_and_logged(server: Server, served_folder: Path):
    answer = httpx.get(f"{server.url}/v1/datasets", headers={"X-Request-ID": "my-request.1"})
    assert answer.headers["x-request-id"] == "my-request.1"
    odd = httpx.get(f"{server.url}/v1/datasets", headers={"X-Request-ID": 'a"b c'})
    assert odd.headers["x-request-id"] not in ('a"b c', "my-request.1")
    lines = [json.loads(line) for line in (served_folder / "log").read_text().splitlines()]
    (line,) = [line for line in lines if line.get("request_id") == "my-request.1"]
    assert (line["status"], line["method"], line["path"]) == (200, "GET", "/v1/datasets")
    assert line["level"] == "info" and line["milliseconds"] > 0


def test_the_cache_stays_within_its_bound(folder: Path):
    with embed(folder, cache_bytes=10_000) as store:
        http = store.connection.client
        for alpha in range(1, 9):
            assert http.post(LCOR, params={"alpha": alpha}, json=BODY).status_code == 200
        text = http.get("metrics").text
        assert "ssil_cache_entries 1.0" in text
        (misses,) = re.findall(r"^ssil_cache_misses_total (.*)$", text, re.MULTILINE)
        assert float(misses) >= 8


def test_a_new_run_is_seen_without_restart(http: httpx.Client, local):
    import ssil_data as sd

    assert http.get("v1/datasets/drives/runs/late").status_code == 404
    sd.score(local["drives"], sd.VAE(steps=5), run="late")
    assert http.get("v1/datasets/drives/runs/late").status_code == 200
    before = http.get("v1/datasets/drives").json()["version"]
    local["drives"].append([sd.Episode([[1.0, 2, 3]], [[0.0, 1]])])
    assert http.get("v1/datasets/drives").json()["version"] != before
    assert http.post(LCOR, json=BODY).status_code == 409
    assert http.post(LCOR, params={"version": before}, json=BODY).status_code == 200


def test_a_store_that_was_moved_away_is_not_ready(http: httpx.Client, folder: Path):
    assert http.get("readyz").status_code == 200
    folder.rename(folder.parent / "elsewhere")
    for path in ("readyz", "v2/health/ready"):
        assert http.get(path).status_code == 503
    assert http.get("healthz").status_code == 200
    (folder.parent / "elsewhere").rename(folder)
    assert http.get("readyz").status_code == 200
