"""The client is the local store over REST: the same surface, the same bits, and retries."""

import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from numpy.testing import assert_array_equal

import ssil_data as sd
from ssil_data.client import RemoteDataset, RemoteStore, RetryPolicy, connect
from ssil_data.client.connection import Connection
from ssil_service import embed
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives

QUICK = RetryPolicy(first=0.001, longest=0.01, total=1.0)


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> sd.Store:
    store = sd.Store(tmp_path_factory.mktemp("client") / "store")
    dataset = store.create(
        "drives", drives(), state_names=STATE_NAMES, action_names=ACTION_NAMES, card="# Drives"
    )
    sd.score(dataset, sd.MDN(steps=20), run="mdn")
    return store


@pytest.fixture(scope="module")
def remote(local: sd.Store) -> Iterator[RemoteStore]:
    with embed(local.folder.uri, jobs=1) as store:
        yield store


@pytest.fixture(scope="module")
def dataset(remote: RemoteStore) -> RemoteDataset:
    return remote["drives"]


def test_the_store_lists_and_opens_its_datasets(remote: RemoteStore, local: sd.Store):
    assert remote.names() == local.names()
    assert [dataset.name for dataset in remote] == [dataset.name for dataset in local]
    assert "drives" in remote and "nope" not in remote
    with pytest.raises(sd.NotFoundError):
        remote["nope"]
    with pytest.raises(sd.InvalidInputError):
        remote["../etc"]


@pytest.mark.parametrize("what", ["name", "version", "card", "state_names", "action_names"])
def test_a_dataset_says_of_itself_what_the_local_one_does(
    what: str, dataset: RemoteDataset, local: sd.Store
):
    assert getattr(dataset, what) == getattr(local["drives"], what)


def test_a_dataset_reads_like_the_local_one(dataset: RemoteDataset, local: sd.Store):
    here = local["drives"]
    assert len(dataset) == len(here)
    assert dataset.versions == here.versions
    assert dataset.at(here.version).version == here.version
    assert dataset.episodes.equals(here.episodes)
    assert_array_equal(dataset.per_pair("labeled"), here.per_pair("labeled"))
    assert dataset.read_recorded("reward") is None
    for found, expected in (
        (dataset.pairs(), here.pairs()),
        (dataset.episode(3), here.episode(3)),
        (dataset.labeled(), here.labeled()),
    ):
        for name in ("states", "actions", "episode", "step"):
            assert_array_equal(getattr(found, name), getattr(expected, name))
            assert getattr(found, name).dtype == getattr(expected, name).dtype


@pytest.mark.parametrize("number", [-1, 11, 99, 2**70])
def test_an_episode_that_is_none_is_refused_as_locally(
    number: int, dataset: RemoteDataset, local: sd.Store
):
    with pytest.raises(sd.NotFoundError) as here:
        local["drives"].episode(number)
    with pytest.raises(sd.NotFoundError) as there:
        dataset.episode(number)
    assert str(there.value) == str(here.value)


def test_runs_are_the_local_records(dataset: RemoteDataset, local: sd.Store):
    here = local["drives"]
    assert [run.name for run in dataset.runs] == [run.name for run in here.runs]
    assert dataset.runs["mdn"] == here.runs["mdn"]
    assert dataset.runs.values("mdn").equals(here.runs.values("mdn"))
    assert_array_equal(dataset.leverage("mdn"), here.leverage("mdn"))
    with pytest.raises(sd.NotFoundError):
        dataset.runs["nope"]


def test_a_field_answers_bit_for_bit_like_the_local_one(dataset: RemoteDataset, local: sd.Store):
    remote, here = dataset.field("mdn"), local["drives"].field("mdn")
    states = local["drives"].pairs().states[::7]
    assert remote.alpha == here.alpha
    for options in ({}, {"contributors": 4}, {"tolerance": 0.05}, {"tolerance": 1.0, "seed": 3}):
        found, expected = remote.lcor(states, **options), here.lcor(states, **options)
        for name in ("values", "effective_sample_size", "half_width"):
            assert_array_equal(getattr(found, name), getattr(expected, name))
        assert_array_equal(found.contributors.row, expected.contributors.row)
        assert_array_equal(found.contributors.share, expected.contributors.share)
    assert_array_equal(remote.cor(states), here.cor(states))
    sums, expected = remote.sums(states, contributors=2), here.sums(states, contributors=2)
    for name in ("numerator", "denominator", "squares", "log_scale", "nearest", "nearest_weight"):
        assert_array_equal(getattr(sums, name), getattr(expected, name))


def test_another_alpha_is_that_of_the_local_field(dataset: RemoteDataset, local: sd.Store):
    states = local["drives"].pairs().states[:5]
    found = dataset.field("mdn", alpha=0.1 + 0.2).lcor(states).values
    assert_array_equal(found, local["drives"].field("mdn", alpha=0.1 + 0.2).lcor(states).values)


def test_no_states_get_no_answers(dataset: RemoteDataset):
    assert len(dataset.field("mdn").lcor(np.empty((0, 3))).values) == 0


def test_more_states_than_one_question_takes_are_asked_in_several(local: sd.Store):
    states = local["drives"].pairs().states[:50]
    with embed(local.folder.uri, query_rows=16) as store:
        found = store["drives"].field("mdn").cor(states)
    assert_array_equal(found, local["drives"].field("mdn").cor(states))


def test_long_answers_come_in_pages(local: sd.Store):
    with embed(local.folder.uri, page_rows=100) as store:
        assert_array_equal(store["drives"].leverage("mdn"), local["drives"].leverage("mdn"))
        assert_array_equal(store["drives"].pairs().states, local["drives"].pairs().states)


def test_states_are_refused_as_they_are_locally(dataset: RemoteDataset, local: sd.Store):
    for states in (np.ones((2, 4)), np.full((1, 3), np.nan), np.full((1, 3), 1e300), np.ones(3)):
        with pytest.raises(sd.InvalidInputError) as here:
            local["drives"].field("mdn").lcor(states)
        with pytest.raises(sd.InvalidInputError) as there:
            dataset.field("mdn").lcor(states)
        assert str(there.value) == str(here.value)


def test_a_model_scores_pairs_like_the_local_one(dataset: RemoteDataset, local: sd.Store):
    pairs = local["drives"].episode(4)
    found = dataset.model("mdn")(pairs)
    expected = local["drives"].model("mdn")(pairs)
    assert_array_equal(found.uncertainty, expected.uncertainty)
    assert_array_equal(found.leverage, expected.leverage)
    assert set(found.parts) == set(expected.parts)
    assert_array_equal(found.parts["epistemic"], expected.parts["epistemic"])


def test_a_run_is_made_as_locally_and_tells_its_progress(remote: RemoteStore, tmp_path: Path):
    told: list[tuple[str, int, int]] = []
    made = remote["drives"].score(
        sd.Recipe(sd.VAE(steps=20), sd.MinMax()), seed=5, progress=lambda *step: told.append(step)
    )
    twin = sd.Store(tmp_path).create(
        "drives", drives(), state_names=STATE_NAMES, action_names=ACTION_NAMES
    )
    expected = sd.score(twin, sd.Recipe(sd.VAE(steps=20), sd.MinMax()), seed=5)
    assert_array_equal(remote["drives"].leverage(made.name), twin.leverage(expected.name))
    assert (made.seed, made.scale, made.model) == (5, expected.scale, expected.model)
    assert told[-1] == ("score", 420, 420)
    again = remote["drives"].rescore(remote["drives"], made.name, run="again")
    assert again.model == made.model


def test_a_failed_job_raises_what_scoring_raises(remote: RemoteStore):
    unlabeled = [drive(1, 20), drive(2, 20)]
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    dataset = remote.create("unlabeled", unlabeled, **names)
    with pytest.raises(sd.InvalidInputError, match="labeled"):
        dataset.score(sd.VAE())
    remote.delete("unlabeled")
    assert "unlabeled" not in remote


def test_a_dataset_written_over_rest_is_the_one_written_locally(
    remote: RemoteStore, tmp_path: Path
):
    walk = np.random.default_rng(0).normal(size=(9, 3))
    full = sd.Episode(
        walk, walk[:, :2], True, "lap 1", walk[:, 0], walk[:, :2], 0.5, "expert", "terminated"
    )
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    there = remote.create("written", [full, drive(3, 5)], card="# Here", **names)
    here = sd.Store(tmp_path).create("written", [full, drive(3, 5)], card="# Here", **names)
    assert there.version == here.version
    assert there.card == here.card
    assert there.episodes.equals(here.episodes)
    assert_array_equal(there.episode(0).states, here.episode(0).states)
    longer, expected = there.append([drive(4, 6)]), here.append([drive(4, 6)])
    assert (longer.version, len(there)) == (expected.version, 14)
    with pytest.raises(sd.ConflictError):
        remote.create("written", [full], **names)
    remote.delete("written")


def test_an_opened_dataset_stays_what_it_was(remote: RemoteStore):
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    before = remote.create("growing", drives(), **names)
    run = before.score(sd.VAE(steps=10)).name
    states = before.pairs().states[:4]
    value = before.field(run).lcor(states).values
    before.append([drive(4, 6)])
    assert len(before.pairs()) == 420
    assert_array_equal(before.field(run).lcor(states).values, value)
    with pytest.raises(sd.ConflictError):
        remote["growing"].field(run)
    remote.delete("growing")


def answering(*answers: httpx.Response | Exception) -> tuple[RemoteStore, list[httpx.Request]]:
    """A store whose service gives these answers in turn."""
    seen: list[httpx.Request] = []
    left = iter(answers)

    def answer(request: httpx.Request) -> httpx.Response:
        seen.append(request)
        found = next(left)
        if isinstance(found, Exception):
            raise found
        return found

    transport = httpx.MockTransport(answer)
    return connect("http://service", "the key", retry=QUICK, transport=transport), seen


LISTED = {"datasets": [{"dataset": "drives"}]}
BUSY = {"status": 503, "title": "Busy", "detail": "busy"}


@pytest.mark.parametrize(
    "failure",
    [
        httpx.Response(503, json=BUSY),
        httpx.Response(429, json=BUSY),
        httpx.ConnectError("refused"),
        httpx.ReadError("reset"),
        httpx.RemoteProtocolError("hung up"),
    ],
)
def test_a_busy_or_lost_service_is_asked_again(failure: httpx.Response | Exception):
    store, seen = answering(failure, failure, httpx.Response(200, json=LISTED))
    assert store.names() == ["drives"]
    assert len(seen) == 3
    assert seen[0].headers["authorization"] == "Bearer the key"


def test_retries_end(monkeypatch: pytest.MonkeyPatch):
    store, seen = answering(*[httpx.Response(503, json=BUSY)] * 10_000)
    with pytest.raises(sd.ServiceError, match="busy"):
        store.names()
    assert len(seen) > 10


def test_the_time_that_a_busy_service_names_is_waited():
    waited = httpx.Response(503, json=BUSY, headers={"Retry-After": "0.2"})
    store, _ = answering(waited, httpx.Response(200, json=LISTED))
    begin = time.monotonic()
    store.names()
    assert time.monotonic() - begin >= 0.2


def test_what_may_not_be_repeated_is_not_sent_twice():
    store, seen = answering(httpx.ReadError("reset"), httpx.Response(204))
    with pytest.raises(sd.ServiceError, match="reset; the change may have been made: look before"):
        store.delete("drives")
    assert len(seen) == 1


@pytest.mark.parametrize("status", [429, 503])
def test_what_may_not_be_repeated_is_repeated_after_refusals_before_any_work_alone(status: int):
    begun = httpx.Response(status, json=BUSY, headers={"Retry-After": "0"})
    store, seen = answering(begun, begun, httpx.Response(204))
    store.delete("drives")
    assert len(seen) == 3
    store, seen = answering(httpx.Response(status, json=BUSY), httpx.Response(204))
    with pytest.raises(sd.ServiceError, match="busy; the change may have been made: look before"):
        store.delete("drives")
    assert len(seen) == 1


def test_an_append_whose_answer_was_held_back_is_made_once(local: sd.Store):
    """The service has too much to hold for the answer, after the commit."""
    with embed(local.folder.uri, jobs=1) as store:
        names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
        dataset = store.create("once", [drive(0, 5)], **names)
        client = store.connection.client
        send = client.send

        def refused(request: httpx.Request) -> httpx.Response:
            answer = send(request)
            late = httpx.Response(503, json=BUSY, request=request)
            return late if request.url.path.endswith("/episodes") else answer

        client.send = refused  # pyright: ignore[reportAttributeAccessIssue]
        with pytest.raises(sd.ServiceError, match="may have been made: look"):
            dataset.append([drive(1, 5)])
        assert len(local["once"].episodes) == 2
        store.delete("once")


@pytest.mark.parametrize("name", ["mdn?", "mdn#x", "..", "../../drives", "a/b", "", "mdn%2e"])
def test_a_name_that_no_run_can_have_is_refused_as_locally(
    name: str, dataset: RemoteDataset, local: sd.Store
):
    here = local["drives"]
    for ask in ("values", "of_any_version", "__getitem__"):
        with pytest.raises(sd.InvalidInputError) as expected:
            getattr(here.runs, ask)(name)
        with pytest.raises(sd.InvalidInputError) as found:
            getattr(dataset.runs, ask)(name)
        assert str(found.value) == str(expected.value)
    for ask in ("leverage", "field", "model"):
        with pytest.raises(sd.InvalidInputError, match="run name"):
            getattr(dataset, ask)(name)


def test_many_short_episodes_are_written_at_once(remote: RemoteStore):
    pair = np.zeros((2, 3)), np.zeros((2, 2))
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    many = [sd.Episode(*pair, labeled=number == 0) for number in range(5_000)]
    written = remote.create("short", many, **names)
    assert (len(written.episodes), len(written)) == (5_000, 10_000)
    assert len(written.append(many).episodes) == 10_000
    remote.delete("short")


def test_a_store_that_is_closed_says_so(local: sd.Store):
    store = embed(local.folder.uri, jobs=1)
    store.close()
    with pytest.raises(sd.ServiceError, match="this store is closed; connect again"):
        store.names()


class Slow(BaseHTTPRequestHandler):
    """A service that takes longer for its work than a client waits for an answer."""

    asked = 0

    def do_PUT(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        Slow.asked += 1
        time.sleep(0.6)
        self._answer({"dataset": "slow", "version": "0" * 16})

    def do_GET(self) -> None:
        time.sleep(0.6 if self.path == "/v1/datasets" else 0)
        self._answer({"query_rows": 10, "datasets": []})

    def _answer(self, found: dict[str, Any]) -> None:
        body = json.dumps(found).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        with contextlib.suppress(BrokenPipeError):
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None: ...


@pytest.fixture
def slow() -> Iterator[ThreadingHTTPServer]:
    with ThreadingHTTPServer(("127.0.0.1", 0), Slow) as server:
        Slow.asked = 0
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def test_what_takes_work_is_waited_for_and_asked_once(slow: ThreadingHTTPServer):
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    with connect(f"http://127.0.0.1:{slow.server_port}", timeout=0.2, retry=QUICK) as store:
        assert store.create("slow", [drive(0, 5)], **names).name == "slow"
        with pytest.raises(sd.ServiceError, match="timed out"):
            store.names()
    assert Slow.asked == 1


def test_the_wait_for_work_has_an_end_that_tells_what_may_have_happened(slow: ThreadingHTTPServer):
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    url = f"http://127.0.0.1:{slow.server_port}"
    store = connect(url, work_timeout=0.2, retry=QUICK)
    with store, pytest.raises(sd.ServiceError, match="the change may have been made"):
        store.create("slow", [drive(0, 5)], **names)
    assert Slow.asked == 1


@pytest.mark.parametrize(
    ("status", "kind"),
    [
        (404, sd.NotFoundError),
        (409, sd.ConflictError),
        (422, sd.InvalidInputError),
        (413, sd.InvalidInputError),
        (401, sd.ServiceError),
        (403, sd.ServiceError),
        (500, sd.ServiceError),
    ],
)
def test_problems_are_the_errors_of_the_library(status: int, kind: type[Exception]):
    problem = {"title": "T", "status": status, "detail": "what went wrong", "errors": []}
    store, _ = answering(httpx.Response(status, json=problem))
    with pytest.raises(kind, match="what went wrong"):
        store.names()


def test_an_answer_that_is_no_problem_is_told_by_its_status():
    store, _ = answering(httpx.Response(502, text="<html>"))
    with pytest.raises(sd.ServiceError, match="502"):
        store.names()


def test_a_job_is_asked_for_under_one_key_however_often_it_is_sent():
    limits = {"query_rows": 10}
    summary = {"dataset": "drives", "version": "0" * 16, "pairs": 1}
    lost = httpx.RemoteProtocolError("hung up")
    accepted = httpx.Response(202, json={"job": "1"})
    store, seen = answering(lost, accepted)
    RemoteDataset(store.connection, summary, limits).start({"estimator": {"kind": "vae"}})
    keys = [request.headers["idempotency-key"] for request in seen]
    assert len(keys) == 2 and keys[0] == keys[1]
    assert json.loads(seen[1].content)["version"] == "0" * 16


def test_threads_may_share_a_store(remote: RemoteStore, local: sd.Store):
    states = local["drives"].pairs().states
    field = remote["drives"].field("mdn")
    expected = [local["drives"].field("mdn").lcor(states[i : i + 5]).values for i in range(8)]
    found: dict[int, np.ndarray] = {}

    def ask(number: int) -> None:
        found[number] = field.lcor(states[number : number + 5]).values

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for number, values in enumerate(expected):
        assert_array_equal(found[number], values)


def test_waits_grow_with_jitter_up_to_a_longest():
    policy = RetryPolicy(first=1, longest=8, total=60)
    for attempt, most in enumerate([1, 2, 4, 8, 8, 8]):
        waits = [policy.seconds_before(attempt, 0) for _ in range(50)]
        assert most / 2 <= min(waits) < max(waits) <= most
    assert policy.seconds_before(0, 5.0) >= 5.0
    assert policy.seconds_before(10_000, 0) <= 8


def test_nothing_is_asked_before_it_is_needed():
    def refuse(request: httpx.Request) -> httpx.Response:
        raise AssertionError("asked")

    asked: Callable[[httpx.Request], httpx.Response] = refuse
    store = connect("http://service", transport=httpx.MockTransport(asked))
    assert isinstance(store.connection, Connection)
    assert "http://service" in repr(store)
    store.close()
