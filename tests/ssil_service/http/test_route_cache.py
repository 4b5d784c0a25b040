"""Questions asked before take a shorter way to the same answers and the same refusals."""

from pathlib import Path

import httpx
import pytest

import ssil_data as sd
from ssil_service import embed

LCOR = "v1/datasets/drives/runs/vae/lcor"
BODY = {"states": [[1.0, 2.0, 3.0]]}
READ_KEY, OTHER_KEY = "reads-and-asks-only", "writes-and-deletes-too"


@pytest.mark.parametrize("path", ["lcor?contributors=2", "lcor?alpha=3&sums=true", "cor", "score"])
def test_the_second_answer_is_the_first(path: str, asked: httpx.Client):
    body = {**BODY, "actions": [[1.0, 2.0]]} if path == "score" else BODY
    url = f"v1/datasets/drives/runs/vae/{path}"
    first, second = (asked.post(url, json=body) for _ in range(2))
    assert first.status_code == second.status_code == 200
    assert first.content == second.content
    other = asked.post(url.replace("=2", "=1").replace("=3", "=4"), json=body)
    assert (other.content == first.content) == ("?" not in path)


def test_refusals_are_the_same_on_both_ways(http: httpx.Client, local: sd.Store):
    def refused(**request) -> tuple[int, str]:
        answer = http.post(LCOR, **request)
        assert answer.headers["content-type"] == "application/problem+json"
        return answer.status_code, answer.text

    mistakes = [
        {"json": {"states": [[1, 2]]}},
        {"content": b"x", "headers": {"Content-Type": "text/csv"}},
        {"json": BODY, "headers": {"Accept": "text/csv"}},
    ]
    before = [refused(**each) for each in mistakes]
    assert http.post(LCOR, json=BODY).status_code == 200  # from now on the short way
    assert [refused(**each) for each in mistakes] == before
    assert [status for status, _ in before] == [422, 415, 406]
    local["drives"].append([sd.Episode([[1.0, 2, 3]], [[0.0, 1]])])
    status, text = refused(json=BODY)
    assert status == 409 and str(local.folder.uri) not in text
    http.delete("v1/datasets/drives")
    assert refused(json=BODY)[0] == 404


def test_the_shorter_way_is_nobody_elses(folder: Path):
    with embed(folder, read_key=READ_KEY, write_key=OTHER_KEY) as store:
        http = store.connection.client

        def status(headers: dict[str, str]) -> int:
            return http.post(LCOR, json=BODY, headers=headers).status_code

        right = {"X-API-Key": READ_KEY}
        assert [status(right) for _ in range(3)] == [200] * 3
        assert status({}) == 401
        assert status({"X-API-Key": READ_KEY + "x"}) == 401
        assert status({"Authorization": READ_KEY}) == 401
        assert status({**right, "Authorization": "Bearer wrong"}) == 401
        assert status({"Authorization": f"Bearer {OTHER_KEY}"}) == 200


def test_metrics_name_the_route_on_both_ways(http: httpx.Client):
    for _ in range(3):
        http.post(LCOR, json=BODY)
    route = 'route="/v1/datasets/{dataset}/runs/{run}/lcor"'
    line = f'ssil_request_seconds_count{{method="POST",{route},status="200"}} 3.0'
    assert line in http.get("metrics").text
