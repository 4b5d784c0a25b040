"""Questions over REST: the numbers of the local store, in every form, and refusals by place."""

import io
from pathlib import Path

import httpx
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.testing import assert_array_equal

import ssil_data as sd
from ssil_data.client.wire import ARROW, JSON, PARQUET, decode, encode, rows_of_matrix
from ssil_service import embed

LCOR = "v1/datasets/drives/runs/vae/lcor"
SCORE = "v1/datasets/drives/runs/vae/score"


def parquet(table: pa.Table) -> bytes:
    sink = io.BytesIO()
    pq.write_table(table, sink)
    return sink.getvalue()


def body_of(media: str, states: np.ndarray) -> dict:
    if media == JSON:
        return {"json": {"states": states.tolist()}}
    table = pa.table({"state": rows_of_matrix(states)})
    content = encode(table).to_pybytes() if media == ARROW else parquet(table)
    return {"content": content, "headers": {"Content-Type": media}}


def columns_of(answer: httpx.Response) -> dict:
    media = answer.headers["content-type"]
    if media == JSON:
        return answer.json()
    table = decode(answer.content) if media == ARROW else pq.read_table(io.BytesIO(answer.content))
    return table.to_pydict()


@pytest.mark.parametrize("sent", [JSON, ARROW, PARQUET])
@pytest.mark.parametrize("wanted", [JSON, ARROW, PARQUET])
def test_lcor_is_the_same_number_in_every_form(
    sent: str, wanted: str, shared_http: httpx.Client, scored: Path, states: np.ndarray
):
    request = body_of(sent, states)
    request["headers"] = {**request.get("headers", {}), "Accept": wanted}
    answer = shared_http.post(LCOR, params={"contributors": 3}, **request)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == wanted
    columns = columns_of(answer)
    expected = sd.Store(scored)["drives"].field("vae").lcor(states, contributors=3)
    assert_array_equal(columns["values"], expected.values)
    assert_array_equal(columns["effective_sample_size"], expected.effective_sample_size)
    assert_array_equal(columns["contributor_row"], expected.contributors.row)
    assert_array_equal(columns["contributor_share"], expected.contributors.share)


def test_weighted_sums_of_two_shards_add_up_to_lcor(
    shared_http: httpx.Client, scored: Path, states: np.ndarray
):
    answer = shared_http.post(LCOR, params={"sums": True}, **body_of(JSON, states)).json()
    expected = sd.Store(scored)["drives"].field("vae").lcor(states).values
    assert_array_equal(np.divide(answer["numerator"], answer["denominator"]), expected)


def test_another_alpha_is_another_field(
    shared_http: httpx.Client, scored: Path, states: np.ndarray
):
    answer = shared_http.post(LCOR, params={"alpha": 3.5}, **body_of(JSON, states)).json()
    assert answer["alpha"] == 3.5
    assert_array_equal(
        answer["values"], sd.Store(scored)["drives"].field("vae", alpha=3.5).lcor(states).values
    )


def test_pairs_never_seen_get_the_leverage_of_the_local_model(
    shared_http: httpx.Client, scored: Path
):
    rng = np.random.default_rng(1)
    states = rng.normal(size=(9, 3))
    actions = rng.normal(size=(9, 2))
    body = {"states": states.tolist(), "actions": actions.tolist()}
    answer = shared_http.post(SCORE, json=body).json()
    model = sd.Store(scored)["drives"].model("vae")
    expected = model(sd.Pairs(states, actions, np.zeros(9, int), np.arange(9)))
    assert_array_equal(answer["uncertainty"], expected.uncertainty)
    assert_array_equal(answer["leverage"], expected.leverage)
    assert answer["aleatoric"] == [None] * 9


@pytest.mark.parametrize("accept", ["text/html", "application/json;q=0", "image/*"])
def test_an_unknown_form_of_answer_is_refused(
    accept: str, shared_http: httpx.Client, states: np.ndarray
):
    answer = shared_http.post(LCOR, headers={"Accept": accept}, **body_of(JSON, states))
    assert (answer.status_code, answer.headers["content-type"]) == (406, "application/problem+json")


@pytest.mark.parametrize(
    ("accept", "form"),
    [
        ("", JSON),
        ("*/*", JSON),
        (f"{JSON};q=0.5, {ARROW}", ARROW),
        (f"application/*;q=0.2, {PARQUET};q=0.3", PARQUET),
    ],
)
def test_the_preferred_form_is_given(
    accept: str, form: str, shared_http: httpx.Client, states: np.ndarray
):
    answer = shared_http.post(LCOR, headers={"Accept": accept}, **body_of(JSON, states))
    assert answer.headers["content-type"] == form


def test_every_offending_cell_is_named_by_row_and_column(shared_http: httpx.Client):
    body = b'{"states": [[1, 2, 3], [1, 1e300, 3], ["x", 2, null]]}'
    answer = shared_http.post(LCOR, content=body, headers={"Content-Type": JSON})
    assert answer.status_code == 422
    places = [(fault["field"], fault["row"], fault["column"]) for fault in answer.json()["errors"]]
    assert places == [("states", 1, 1), ("states", 2, 0), ("states", 2, 2)]


def test_numbers_that_overflow_float32_are_refused_by_place(shared_http: httpx.Client):
    states = np.ones((4, 3))
    states[2, 1] = 1e300
    states[3, 0] = np.nan
    table = pa.table({"state": rows_of_matrix(states)})
    for media, content in ((ARROW, encode(table).to_pybytes()), (PARQUET, parquet(table))):
        answer = shared_http.post(LCOR, content=content, headers={"Content-Type": media})
        assert answer.status_code == 422
        places = [(fault["row"], fault["column"]) for fault in answer.json()["errors"]]
        assert places == [(2, 1), (3, 0)]


def test_rows_of_another_width_are_named(shared_http: httpx.Client):
    answer = shared_http.post(LCOR, json={"states": [[1, 2, 3], [1, 2], [1, 2, 3], [1]]})
    assert answer.status_code == 422
    assert [fault["row"] for fault in answer.json()["errors"]] == [1, 3]
    assert "expected width 3, found 2" in answer.json()["detail"]


def test_bodies_are_not_echoed(shared_http: httpx.Client):
    secret = "sesame-open-the-door"
    for body in ({"states": [[secret]]}, {"states": [], secret: 1}, [secret]):
        answer = shared_http.post(LCOR, json=body)
        assert answer.status_code == 422
        values = [fault["detail"] for fault in answer.json()["errors"]]
        assert not any(secret in value for value in values if "Extra inputs" not in value)


def test_another_kind_or_coding_of_body_is_refused(shared_http: httpx.Client):
    for headers in (
        {"Content-Type": "text/csv"},
        {},
        {"Content-Type": JSON, "Content-Encoding": "gzip"},
    ):
        answer = shared_http.post(LCOR, content=b"{}", headers=headers)
        assert answer.status_code == 415


def test_compressed_arrow_buffers_are_refused_before_they_are_decompressed(
    shared_http: httpx.Client,
):
    table = pa.table({"state": rows_of_matrix(np.zeros((20_000, 3), np.float32))})
    sink = pa.BufferOutputStream()
    options = pa.ipc.IpcWriteOptions(compression="zstd")
    with pa.ipc.new_stream(sink, table.schema, options=options) as stream:
        stream.write_table(table)
    answer = shared_http.post(
        LCOR, content=sink.getvalue().to_pybytes(), headers={"Content-Type": ARROW}
    )
    assert answer.status_code == 415


def test_a_stream_that_begins_with_another_message_is_refused(shared_http: httpx.Client):
    table = pa.table({"state": rows_of_matrix(np.ones((4, 3), np.float32))})
    content = encode(table).to_pybytes()
    schema = pa.ipc.read_message(content)
    sink = pa.BufferOutputStream()
    schema.serialize_to(sink)
    rows = content[sink.tell() :]
    typeless = content.replace(b"\x0c\0\x06\0\x05\0", b"\x0c\0\x06\0\x0d\0", 1)
    assert pa.ipc.MessageReader.open_stream(typeless).read_next_message().type == "unknown"
    for body in (rows, b"", content[: sink.tell()] * 2, rows + content, typeless):
        answer = shared_http.post(LCOR, content=body, headers={"Content-Type": ARROW})
        assert answer.status_code == 422
    assert (
        shared_http.post(LCOR, content=content, headers={"Content-Type": ARROW}).status_code == 200
    )


def test_more_rows_than_one_question_takes_are_refused(shared_http: httpx.Client):
    most = shared_http.get("v1/limits").json()["query_rows"]
    table = pa.table({"state": rows_of_matrix(np.zeros((most + 1, 3), np.float32))})
    for media, content in ((ARROW, encode(table).to_pybytes()), (PARQUET, parquet(table))):
        answer = shared_http.post(LCOR, content=content, headers={"Content-Type": media})
        assert answer.status_code == 413, media
    answer = shared_http.post(LCOR, json={"states": [[0.0] * 3] * (most + 1)})
    assert answer.status_code == 413


def test_a_parquet_bomb_costs_a_worker_and_not_the_service(folder: Path):
    rows = 30_000
    wide = pa.FixedSizeListArray.from_arrays(pa.repeat(pa.scalar(0.0), rows * 3_000), 3_000)
    content = parquet(pa.table({"state": wide}))
    assert len(content) < 2_000_000
    with embed(folder, decoded_bytes=2**24) as store:
        client = store.connection.client
        answer = client.post(LCOR, content=content, headers={"Content-Type": PARQUET})
        assert answer.status_code == 413
        assert client.post(LCOR, json={"states": [[1, 2, 3]]}).status_code == 200


@pytest.mark.parametrize("depth", [100, 100_000])
def test_deeply_nested_json_is_refused(depth: int, shared_http: httpx.Client):
    body = b'{"states": ' + b"[" * depth + b"]" * depth + b"}"
    answer = shared_http.post(LCOR, content=body, headers={"Content-Type": JSON})
    assert answer.status_code == 422


def test_what_does_not_exist_is_a_problem_that_names_no_place_on_the_machine(
    shared_http: httpx.Client, scored: Path
):
    for path in (
        "v1/datasets/nope",
        "v1/datasets/drives/runs/nope",
        "v1/nope",
        "v1/jobs/" + "0" * 16,
    ):
        answer = shared_http.get(path)
        assert (answer.status_code, answer.headers["content-type"]) == (
            404,
            "application/problem+json",
        )
        assert str(scored) not in answer.text


@pytest.mark.parametrize("name", ["..", ".service", "%2e%2e", "a%2Fb", "..%2F..%2Fetc", "x" * 101])
def test_names_cannot_leave_the_store(name: str, shared_http: httpx.Client):
    for method in ("GET", "DELETE", "PUT"):
        answer = shared_http.request(method, f"http://embedded/v1/datasets/{name}/runs")
        assert answer.status_code in (404, 405, 422)
        answer = shared_http.request(method, f"http://embedded/v1/datasets/{name}")
        assert answer.status_code in (404, 405, 415, 422)


def test_a_method_that_a_path_has_not_gets_those_it_has(shared_http: httpx.Client):
    answer = shared_http.patch("v1/datasets/drives")
    assert (answer.status_code, answer.headers["allow"]) == (405, "DELETE, GET, HEAD, PUT")


def test_unknown_parameters_are_named(shared_http: httpx.Client):
    for path in ("v1/datasets", "v1/datasets/drives/pairs", "healthz", "v2/models/drives.vae"):
        answer = shared_http.get(path, params={"ofset": 3, "limi": 1})
        assert answer.status_code == 422
        assert [fault["field"] for fault in answer.json()["errors"]] == ["ofset", "limi"]
    answer = shared_http.post(LCOR, params={"contributers": 3}, json={"states": [[1, 2, 3]]})
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, "contributers")


@pytest.mark.parametrize("option", ["tolerance", "relative", "seconds", "seed"])
def test_sums_of_a_part_of_the_pairs_are_refused(option: str, shared_http: httpx.Client):
    params = {"sums": True, option: 1}
    answer = shared_http.post(LCOR, params=params, json={"states": [[1, 2, 3]]})
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, option)


def test_heads_are_told_without_bodies(shared_http: httpx.Client):
    for path in ("healthz", "readyz", "v1/datasets/drives/pairs"):
        told = shared_http.head(path)
        whole = shared_http.get(path)
        assert (told.status_code, told.content) == (200, b"")
        assert told.headers["content-length"] == str(len(whole.content))


def test_odd_values_of_json_are_refused_by_place(shared_http: httpx.Client):
    row = [0.5, 1, 2]
    for states, places in (
        ([row, [True, 1, 2]], [(1, 0)]),
        ([row, ["1", 1, None]], [(1, 0), (1, 2)]),
        ([row, [10**40, 1, -(10**400)]], [(1, 0), (1, 2)]),
        ([row, 5, row, {}], [(1, None), (3, None)]),
        ([], None),
    ):
        answer = shared_http.post(LCOR, json={"states": states})
        faults = answer.json().get("errors")
        found = faults and [(fault["row"], fault.get("column")) for fault in faults]
        assert (answer.status_code, found) == (422 if places else 200, places)
    pairs = {"states": [row] * 3, "actions": [[1, 2]] * 3, "step": [0, 1.0, 2]}
    assert shared_http.post(SCORE, json=pairs).status_code == 200
    for odd in ([0, True, 2], [0, 1.5, 2], [0, 2**63, 2]):
        answer = shared_http.post(SCORE, json={**pairs, "step": odd})
        assert (answer.status_code, answer.json()["errors"][0]["row"]) == (422, 1)
