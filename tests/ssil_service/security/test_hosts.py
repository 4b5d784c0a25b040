"""Host and Origin checks: without keys, no web page of another site reaches the service."""

from pathlib import Path
from typing import Any

import httpx
import pytest

from ssil_service import embed
from ssil_service.problems import Problem
from ssil_service.security.hosts import Hosts
from ssil_service.settings import Settings


@pytest.mark.parametrize("host", ["rebound.example", "rebound.example:8000", "", "127.0.0.1.x"])
def test_a_foreign_host_is_misdirected(host: str, shared_http: httpx.Client):
    for path in ("v1/datasets", "healthz", "openapi.json", "docs"):
        answer = shared_http.get(path, headers={"Host": host})
        assert (answer.status_code, answer.headers["content-type"]) == (
            421,
            "application/problem+json",
        )


@pytest.mark.parametrize(
    "host", ["localhost", "LOCALHOST:8000", "127.0.0.1:1", "[::1]:8000", "[0:0:0:0:0:0:0:1]:1"]
)
def test_local_names_are_answered(host: str, shared_http: httpx.Client):
    assert shared_http.get("v1/datasets", headers={"Host": host}).status_code == 200


def test_a_request_target_may_name_the_host(raw: Any):
    def status(target: str, host: str) -> bytes:
        head = f"GET {target} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"
        return raw(head.encode()).makefile("rb").readline().split()[1]

    assert status("http://localhost/v1/datasets/many?version=x", "localhost") == b"422"
    assert status("HTTP://127.0.0.1:80/v1/datasets/many", "elsewhere.example") == b"200"
    assert status("http://localhost", "localhost") == b"404"
    assert status("http://elsewhere.example/v1/datasets", "localhost") == b"421"


def test_the_bound_address_is_answered():
    Hosts.of(Settings(host="fe80:0::1")).refuse_foreign("GET", {b"host": b"[FE80::1]:80"})
    hosts = Hosts.of(Settings(host="127.8.8.8"))
    hosts.refuse_foreign("GET", {b"host": b"127.8.8.8:8000"})
    with pytest.raises(Problem):
        hosts.refuse_foreign("GET", {b"host": b"127.8.8.9:8000"})


@pytest.mark.parametrize("origin", ["https://elsewhere.example", "http://localhost:3000", "null"])
def test_another_site_may_change_nothing(origin: str, http: httpx.Client):
    headers = {"Host": "localhost:8000", "Origin": origin}
    assert http.delete("v1/datasets/drives", headers=headers).status_code == 403
    assert http.post("v1/jobs/" + "0" * 16 + "/cancel", headers=headers).status_code == 403
    own = {"Host": "localhost:8000", "Origin": "http://localhost:8000"}
    assert http.delete("v1/datasets/drives", headers=own).status_code == 204


def test_with_keys_any_host_is_answered(folder: Path):
    with embed(folder, read_key="reads-and-asks-only") as store:
        headers = {"Host": "data.example", "X-API-Key": "reads-and-asks-only"}
        assert store.connection.client.get("v1/datasets", headers=headers).status_code == 200
