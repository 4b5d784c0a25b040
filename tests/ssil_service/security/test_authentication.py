"""API keys: a read key may query, a write key may change, and without a key nothing is open."""

import time
from pathlib import Path

import pytest

from ssil_data.errors import InvalidInputError
from ssil_service import embed
from ssil_service.security.authentication import Keys, refuse_open_access
from ssil_service.settings import Settings
from ssil_service.workers.worker import Worker

READ_KEY = "reads-and-asks-only"
WRITE_KEY = "writes-and-deletes-too"


@pytest.mark.parametrize("header", ["X-API-Key", "Authorization"])
def test_a_key_opens_the_routes_of_its_kind(header: str, folder: Path):
    prefix = "Bearer " if header == "Authorization" else ""
    with embed(folder, read_key=READ_KEY, write_key=WRITE_KEY) as store:
        http = store.connection.client

        def status(method: str, path: str, key: str | None) -> int:
            headers = {} if key is None else {header: f"{prefix}{key}"}
            return http.request(method, path, headers=headers).status_code

        for path in ("v1/datasets", "v1/limits", "metrics", "v2"):
            assert [status("GET", path, key) for key in (None, "wrong", READ_KEY, WRITE_KEY)] == [
                401,
                401,
                200,
                200,
            ]
        gone = "v1/datasets/nope"
        assert [status("DELETE", gone, key) for key in (None, "wrong", READ_KEY, WRITE_KEY)] == [
            401,
            401,
            403,
            404,
        ]
        for path in ("healthz", "readyz", "v2/health/live", "v2/health/ready"):
            assert status("GET", path, None) == 200


def test_a_key_may_be_given_as_its_digest():
    import hashlib

    digest = hashlib.sha256(READ_KEY.encode()).hexdigest()
    keys = Keys.of(Settings(read_key=f"sha256:{digest}, another-long-key-too"))  # pyright: ignore
    assert keys.may(READ_KEY, write=False) == (True, True)
    assert keys.may("another-long-key-too", write=True) == (True, False)
    assert keys.may(digest, write=False) == (False, False)


@pytest.mark.parametrize(
    "key", ["short", "sha256:abc", "sha256:" + "0" * 63, "schlüssel-schlüssel"]
)
def test_the_refusal_of_a_short_or_odd_key_does_not_show_it(key: str):
    with pytest.raises(InvalidInputError) as refusal:
        Keys.of(Settings(write_key=key))  # pyright: ignore
    assert key not in str(refusal.value)


def test_other_machines_need_a_key():
    for host in ("0.0.0.0", "192.168.0.1", "::", "example.org"):
        with pytest.raises(InvalidInputError, match="loopback"):
            refuse_open_access(Settings(host=host))
        refuse_open_access(Settings(host=host, read_key=READ_KEY))  # pyright: ignore
    for host in ("127.0.0.1", "::1", "localhost", "127.9.9.9"):
        refuse_open_access(Settings(host=host))


def test_two_keys_are_refused_if_one_is_wrong(folder: Path):
    with embed(folder, read_key=READ_KEY, write_key=WRITE_KEY) as store:
        http = store.connection.client

        def status(header: str, bearer: str) -> int:
            headers = {"X-API-Key": header, "Authorization": f"Bearer {bearer}"}
            return http.get("v1/datasets", headers=headers).status_code

        assert status(READ_KEY, WRITE_KEY) == 200
        assert status(READ_KEY, "wrong") == 401
        assert status("wrong", READ_KEY) == 401


def test_every_key_of_a_repeated_header_is_checked(folder: Path):
    with embed(folder, read_key=READ_KEY, write_key=WRITE_KEY) as store:
        http = store.connection.client

        def status(name: str, *keys: str) -> int:
            return http.get("v1/datasets", headers=[(name, key) for key in keys]).status_code

        assert status("X-API-Key", READ_KEY, WRITE_KEY) == 200
        assert status("X-API-Key", READ_KEY, "wrong") == 401
        assert status("X-API-Key", "wrong", READ_KEY) == 401
        assert status("Authorization", f"Bearer {READ_KEY}", "Bearer wrong") == 401
        assert status("Authorization", f"Bearer {READ_KEY}", f"Basic {READ_KEY}") == 401


def test_workers_do_not_inherit_the_keys(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("SSIL_READ_KEY", READ_KEY)
    monkeypatch.setenv("ssil_write_key", WRITE_KEY)
    monkeypatch.setenv("SSIL_LOG_LEVEL", "info")
    lock = tmp_path / "lock"
    lock.touch()
    worker = Worker(lock, 2**30)
    try:
        place = Path(f"/proc/{worker.pid}/environ")
        while not (environment := place.read_bytes()):  # the program has not started yet
            time.sleep(0.01)
    finally:
        worker.kill()
    assert b"SSIL_LOG_LEVEL=info" in environment
    assert READ_KEY.encode() not in environment
    assert WRITE_KEY.encode() not in environment
