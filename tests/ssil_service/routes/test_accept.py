"""Which media type an answer has, by the header Accept (RFC 9110, section 12.5.1)."""

import httpx
import pytest

from ssil_data.client.wire import ARROW, JSON, PARQUET

PAIRS = "v1/datasets/drives/pairs"


@pytest.mark.parametrize(
    ("accept", "media"),
    [
        ("", JSON),
        ("*/*", JSON),
        ("application/*", JSON),
        (ARROW, ARROW),
        (f"{JSON};q=0.5, {PARQUET}", PARQUET),
        (f"{ARROW};q=0.9, {PARQUET};q=0.9", ARROW),
        (f"{JSON};q=0, */*", ARROW),
        (f"text/html, {PARQUET};q=0.1", PARQUET),
        (f"{JSON};q=much, {ARROW}", ARROW),
    ],
)
def test_the_preferred_media_type_is_answered(accept: str, media: str, shared_http: httpx.Client):
    answer = shared_http.get(PAIRS, headers={"Accept": accept})
    assert (answer.status_code, answer.headers["content-type"]) == (200, media)
    assert answer.headers["vary"] == "Accept"


@pytest.mark.parametrize("accept", ["text/html", f"{JSON};q=0, text/*"])
def test_no_common_media_type_is_406(accept: str, shared_http: httpx.Client):
    answer = shared_http.get(PAIRS, headers={"Accept": accept})
    assert answer.status_code == 406
    assert ARROW in answer.json()["detail"]
