"""Operation: health, limits, metrics, logs, what the cache holds, what is seen without restart."""

import json
from pathlib import Path

import httpx
from ssil_service import embedded
from ssil_service.launching import Server

LCOR = "v1/datasets/drives/runs/vae/lcor"
BODY = {"states": [[1.0, 2.0, 3.0]]}


def test_health_limits_and_metrics_are_told(http: httpx.Client):
    assert http.get("healthz").json() == {"status": "ok"}
    assert http.get("readyz").json() == {"status": "ok"}
    assert http.get("v1/limits").json()["query_rows"] == 65_536
    http.post(LCOR, json=BODY)
    http.post(LCOR, json=BODY)
    text = http.get("metrics").text
    route = 'route="/v1/datasets/{dataset}/runs/{run}/lcor"'
    assert f'ssil_request_seconds_count{{method="POST",{route},status="200"}} 2.0' in text
    assert 'ssil_rows_total{route="lcor"} 2.0' in text
    assert "ssil_cache_hits 1.0" in text
    assert 'ssil_jobs{state="queued"} 0.0' in text


def test_a_request_id_is_taken_or_given_and_stands_in_the_log(server: Server, served_folder: Path):
    answer = httpx.get(f"{server.url}/v1/datasets", headers={"X-Request-ID": "my-request.1"})
    assert answer.headers["x-request-id"] == "my-request.1"
    odd = httpx.get(f"{server.url}/v1/datasets", headers={"X-Request-ID": 'a"b c'})
    assert odd.headers["x-request-id"] not in ('a"b c', "my-request.1")
    lines = [json.loads(line) for line in (served_folder / "log").read_text().splitlines()]
    (line,) = [line for line in lines if line.get("request_id") == "my-request.1"]
    assert (line["status"], line["method"], line["path"]) == (200, "GET", "/v1/datasets")
    assert line["level"] == "info" and line["milliseconds"] > 0


def test_the_cache_stays_within_its_bound(folder: Path):
    with embedded(folder, cache_bytes=10_000) as store:
        http = store.connection.client
        for alpha in range(1, 9):
            assert http.post(LCOR, params={"alpha": alpha}, json=BODY).status_code == 200
        text = http.get("metrics").text
        assert "ssil_cache_entries 1.0" in text
        assert "ssil_cache_misses 8.0" in text


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
