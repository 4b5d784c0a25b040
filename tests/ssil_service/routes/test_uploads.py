"""Uploads: Parquet and Arrow from anybody become datasets whole, or not at all."""

import io
from collections.abc import Iterable
from pathlib import Path
from unittest.mock import Mock

import httpx
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import ssil_data as sd
from ssil_data.client.upload import episodes_body
from ssil_data.client.wire import ARROW, PARQUET, encode, rows_of_matrix
from ssil_data.store.dataset import Dataset
from ssil_service.formats.arrow import MOST_BATCHES
from ssil_service.workers import tasks
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive

TABLE = pa.table(
    {
        "speed": [1.0, 2.0, 3.0, 4.0, 5.0],
        "heading": [0.1, 0.2, 0.3, 0.4, 0.5],
        "steer": [0.0, 0.1, 0.0, -0.1, 0.2],
        "lap": ["a", "a", "a", "b", "b"],
    }
)
LAYOUT = {"state": ["speed", "heading"], "action": "steer", "episode": "lap", "labeled": "a"}


def parquet(table: pa.Table) -> bytes:
    sink = io.BytesIO()
    pq.write_table(table, sink)
    return sink.getvalue()


BODIES = {ARROW: encode(TABLE).to_pybytes(), PARQUET: parquet(TABLE)}


@pytest.mark.parametrize("media", [ARROW, PARQUET])
def test_named_columns_become_a_dataset(media: str, http: httpx.Client, local: sd.Store):
    headers = {"Content-Type": media}
    answer = http.put("v1/datasets/laps", params=LAYOUT, content=BODIES[media], headers=headers)
    assert answer.status_code == 201, answer.text
    assert answer.headers["location"] == "/v1/datasets/laps"
    summary = answer.json()
    assert (summary["pairs"], summary["episodes"], summary["labeled"]) == (5, 2, 3)
    assert summary["state_names"] == ["speed", "heading"]
    dataset = local["laps"]
    assert dataset.version == summary["version"]
    assert dataset.episodes["source"].to_pylist() == ["upload#a", "upload#b"]
    longer = http.post(
        "v1/datasets/laps/episodes", params=LAYOUT, content=BODIES[media], headers=headers
    )
    assert (longer.status_code, longer.json()["pairs"]) == (201, 10)
    assert http.delete("v1/datasets/laps").status_code == 204
    assert http.get("v1/datasets/laps").status_code == 404
    assert http.delete("v1/datasets/laps").status_code == 404


def test_what_is_no_table_or_no_demonstration_is_refused_and_leaves_nothing(
    http: httpx.Client, local: sd.Store
):
    odd = TABLE.set_column(0, "speed", pa.array([1.0, np.inf, 3.0, 4.0, 5.0]))
    cases = [
        (ARROW, b"no stream", LAYOUT),
        (PARQUET, b"no file", LAYOUT),
        (PARQUET, BODIES[PARQUET][:-20], LAYOUT),
        (ARROW, BODIES[ARROW][:200], LAYOUT),
        (ARROW, b"", LAYOUT),
        (ARROW, BODIES[ARROW], {**LAYOUT, "state": "nope"}),
        (ARROW, BODIES[ARROW], {**LAYOUT, "labeled": "z"}),
        (ARROW, encode(odd).to_pybytes(), LAYOUT),
        (ARROW, encode(TABLE.slice(0, 0)).to_pybytes(), LAYOUT),
    ]
    for media, content, layout in cases:
        headers = {"Content-Type": media}
        answer = http.put("v1/datasets/odd", params=layout, content=content, headers=headers)
        assert answer.status_code in (404, 422), (media, layout, answer.text)
        assert answer.headers["content-type"] == "application/problem+json"
        assert str(local.folder.uri) not in answer.text
    assert local.names() == ["drives"]


def test_a_refusal_names_row_and_column(http: httpx.Client):
    odd = TABLE.set_column(0, "speed", pa.array([1.0, np.inf, 3.0, 4.0, 5.0]))
    content = encode(odd).to_pybytes()
    headers = {"Content-Type": ARROW}
    answer = http.put("v1/datasets/odd", params=LAYOUT, content=content, headers=headers)
    assert "row 1" in answer.json()["detail"] and "speed" in answer.json()["detail"]


def test_a_taken_name_is_refused(http: httpx.Client):
    headers = {"Content-Type": ARROW}
    answer = http.put("v1/datasets/drives", params=LAYOUT, content=BODIES[ARROW], headers=headers)
    assert answer.status_code == 409


def test_a_dataset_is_not_deleted_while_it_is_appended_to(
    local: sd.Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    append = Dataset.append

    def slow(self: Dataset, episodes: Iterable[sd.Episode]) -> Dataset:
        with pytest.raises(sd.ConflictError, match="is being written to; try again later"):
            local.delete("drives")
        return append(self, episodes)

    monkeypatch.setattr(Dataset, "append", slow)
    source = tmp_path / "body"
    source.write_bytes(episodes_body([drive(9, 5)], STATE_NAMES, ACTION_NAMES, ""))
    version = tasks.upload(
        store=str(local.folder.uri),
        dataset="drives",
        source=str(source),
        media=ARROW,
        append=True,
        layout={},
        file="upload",
        most_rows=100,
        report=Mock(),
    )
    assert local["drives"].version == version
    local.delete("drives")


def test_as_many_batches_are_taken_as_are_told_and_no_more(http: httpx.Client):
    def body(batches: int) -> bytes:
        part = pa.table({"state": rows_of_matrix(np.ones((1, 3), np.float32))})
        return encode(pa.concat_tables([part] * batches)).to_pybytes()

    path = "v1/datasets/drives/runs/vae/lcor"
    headers = {"Content-Type": ARROW}
    assert http.post(path, content=body(MOST_BATCHES), headers=headers).status_code == 200
    refused = http.post(path, content=body(MOST_BATCHES + 1), headers=headers)
    assert refused.status_code == 413
    assert f"{MOST_BATCHES} batches" in refused.json()["detail"]


def test_other_dimensions_are_not_appended(http: httpx.Client):
    headers = {"Content-Type": ARROW}
    url = "v1/datasets/drives/episodes"
    answer = http.post(url, params=LAYOUT, content=BODIES[ARROW], headers=headers)
    assert answer.status_code == 422


def test_a_body_above_the_limit_is_refused_by_its_length_and_by_its_bytes(folder: Path):
    from ssil_service import embed

    with embed(folder, upload_bytes=4096, body_bytes=2048) as store:
        http = store.connection.client
        assert http.get("v1/limits").json()["upload_bytes"] == 4096
        headers = {"Content-Type": ARROW}
        for content in (b"x" * 5000, iter([b"x" * 3000, b"x" * 3000])):
            answer = http.put("v1/datasets/large", content=content, headers=headers)
            assert answer.status_code == 413
        answer = http.post("v1/datasets/drives/runs/vae/lcor", content=b"x" * 3000, headers=headers)
        assert answer.status_code == 413


def test_lists_of_a_column_may_be_named_by_the_schema(http: httpx.Client):
    table = pa.table(
        {
            "episode": pa.array([0, 0, 1], pa.int64()),
            "state": rows_of_matrix(np.ones((3, 2), np.float32)),
            "action": rows_of_matrix(np.ones((3, 1), np.float32)),
        },
        metadata={"state_names": '["x", "y"]', "action_names": '["go"]', "card": "# Named"},
    )
    headers = {"Content-Type": ARROW}
    answer = http.put("v1/datasets/named", content=encode(table).to_pybytes(), headers=headers)
    assert answer.json()["state_names"] == ["x", "y"]
    assert http.get("v1/datasets/named/card", headers={"Accept": "*/*"}).text.startswith("# Named")


def test_metadata_that_names_nothing_is_refused(http: httpx.Client):
    for names in (b"[1]", b"{", b"[" * 100_000, b"\xff"):
        table = TABLE.replace_schema_metadata({"state_names": names, "action_names": '["go"]'})
        headers = {"Content-Type": ARROW}
        answer = http.put("v1/datasets/odd", content=encode(table).to_pybytes(), headers=headers)
        assert answer.status_code == 422


def test_changes_meant_for_another_version_are_refused(http: httpx.Client, local: sd.Store):
    headers = {"Content-Type": ARROW}
    body = episodes_body([drive(0, 5)], STATE_NAMES, ACTION_NAMES, "")
    path = "v1/datasets/drives"
    more = "v1/datasets/drives/episodes"
    tag = http.get(path).headers["etag"]
    for known in ('"other"', f"W/{tag}"):
        old = {**headers, "If-Match": known}
        assert http.delete(path, headers=old).status_code == 412
        assert http.post(more, content=body, headers=old).status_code == 412
    new = {**headers, "If-Match": tag}
    assert http.put("v1/datasets/new", content=body, headers=new).status_code == 412
    assert http.post(more, content=body, headers=new).status_code == 201
    assert http.delete(path, headers=new).status_code == 412  # it has grown
    several = [("If-Match", '"other"'), ("If-Match", http.get(path).headers["etag"])]
    assert http.delete(path, headers=several).status_code == 204
    assert local.names() == []


def test_a_key_that_no_upload_remembers_is_refused(http: httpx.Client, local: sd.Store):
    headers = {"Content-Type": ARROW, "Idempotency-Key": "once"}
    body = episodes_body([drive(0, 5)], STATE_NAMES, ACTION_NAMES, "")
    version = local["drives"].version
    for answer in (
        http.post("v1/datasets/drives/episodes", content=body, headers=headers),
        http.put("v1/datasets/new", content=body, headers=headers),
        http.delete("v1/datasets/drives", headers=headers),
    ):
        assert answer.status_code == 422
        assert "Idempotency-Key" in answer.json()["detail"]
    assert (local.names(), local["drives"].version) == (["drives"], version)
