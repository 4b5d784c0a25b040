"""Training gives the same bits through a service at a URL, an embedded one, and from the store."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread

import httpx
import numpy as np
import pytest

from ssil_data.cli import main
from ssil_data.client import RetryPolicy, connect
from ssil_data.commands import serving
from ssil_data.commands.output import StoreLocation
from ssil_data.commands.serving import open_store
from ssil_data.demonstrations import Episode
from ssil_data.estimators import VAE, WindowVAE
from ssil_data.field import LeverageField
from ssil_data.scoring import score
from ssil_data.store import Store
from ssil_service.app import create_app
from ssil_service.server.embedded import EmbeddedTransport
from ssil_service.server.launch import Server, launch
from ssil_service.settings import read_settings
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.commands import train as command
from ssil_trainers.training.checkpoint import CHECKPOINT
from ssil_trainers.training.data import TrainingData
from ssil_trainers.training.data_source import DataSource, load_training_data
from ssil_trainers.training.history import HistoryRow
from ssil_trainers.training.run import (
    CURVE,
    POLICY,
    Callback,
    TrainResult,
    TrainRun,
    train,
)
from support.toy_environment import STEPS, LineEnv, demonstrations

SETTINGS = TrainSettings(
    steps=8 * 4 * STEPS,
    environments=4,
    horizon=STEPS,
    hidden=8,
    discriminator_batch=16,
    boundary=3,
    evaluations=2,
)
ITERATIONS = SETTINGS.iterations
KEY = "reads-and-asks-only"


@pytest.fixture(scope="module")
def toy_store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """A store with the toy's demonstrations, and a run on them."""
    store = Store(tmp_path_factory.mktemp("through") / "store")
    of = demonstrations()
    episodes = [
        Episode(of.states[i : i + 100], of.actions[i : i + 100], labeled=i < 300)
        for i in range(0, len(of.states), 100)
    ]
    made = store.create("toy", episodes, state_names=["place", "goal"], action_names=["move"])
    score(made, VAE(steps=20), run="vae")
    score(made, WindowVAE(steps=20), run="windowvae")
    return store


@pytest.fixture(scope="module")
def server(toy_store: Store) -> Iterator[Server]:
    server = launch(toy_store.folder.uri)
    yield server
    server.kill()


def train_toy(
    data: TrainingData,
    folder: Path,
    method: str = "ssil",
    callback: Callback = lambda row: None,
    *,
    pair_reward: float = 0.0,
) -> None:
    """Train in the toy environment, whose expert's return is taken for -2."""
    data = replace(data, expert_return=-2.0)
    settings = replace(SETTINGS, pair_reward=pair_reward)
    train(method, data, LineEnv, settings=settings, folder=folder, callback=callback)


def files(folder: Path) -> list[bytes]:
    return [(folder / name).read_bytes() for name in (POLICY, CHECKPOINT, CURVE)]


def undisturbed(store: Store, folder: Path) -> list[bytes]:
    train_toy(TrainingData.read(store["toy"], "vae"), folder)
    return files(folder)


def test_one_thread_is_one_thread_for_every_field(toy_store: Store) -> None:
    for threads in (1, None):
        of = TrainingData.read(toy_store["toy"], "vae", threads=threads).demonstrations
        for field in (of.field, of.make_field(of.leverage, 1.0)):
            assert isinstance(field, LeverageField) and field.threads == threads


@pytest.mark.parametrize(
    ("method", "run", "pair_reward"),
    [
        ("ssil", "vae", 0.0),
        ("mixgail", "vae", 0.0),
        ("shuffled", "vae", 0.0),
        ("ssil-leverage", "vae", 0.5),
        ("ssil", "windowvae", 0.5),
    ],
)
def test_rewards_and_policies_are_the_same_three_ways(
    toy_store: Store, server: Server, tmp_path: Path, method: str, run: str, pair_reward: float
) -> None:
    place = StoreLocation(toy_store.folder.uri)
    data = {"store": TrainingData.read(toy_store["toy"], run, threads=1)}
    with open_store(place, None) as embedded, open_store(place, server.url) as remote:
        data["embedded"] = TrainingData.read(embedded["toy"], run)
        data["remote"] = TrainingData.read(remote["toy"], run)
        fields = [found.demonstrations.field for found in data.values()]
        assert {type(field).__name__ for field in fields} == {"LeverageField", "RemoteField"}
        states = np.random.default_rng(0).normal(size=(300, 2)).astype(np.float32)
        rewards = [[field.lcor(states).values, field.cor(states)] for field in fields]
        for name, found in data.items():
            train_toy(found, tmp_path / name, method, pair_reward=pair_reward)
    for other in rewards[1:]:
        np.testing.assert_array_equal(rewards[0], other)
    first, *others = [files(tmp_path / name) for name in data]
    assert others == [first, first]


def test_without_a_url_the_command_embeds_a_service(
    toy_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It leaves nothing in the store, needs no key, and may not be installed."""
    monkeypatch.setenv("SSIL_READ_KEY", KEY)
    monkeypatch.setenv("SSIL_STATE", str(tmp_path / "state"))
    before = sorted(Path(toy_store.folder.uri).iterdir())
    with open_store(StoreLocation(toy_store.folder.uri), None) as store:
        assert type(store).__name__ == "RemoteStore"
        assert store["toy"].version == toy_store["toy"].version
    assert sorted(Path(toy_store.folder.uri).iterdir()) == before
    assert not (tmp_path / "state").exists()
    monkeypatch.setitem(sys.modules, "ssil_service", None)
    with open_store(StoreLocation(toy_store.folder.uri), None) as store:
        assert isinstance(store, Store)


@pytest.mark.parametrize("way", ["store", "embedded", "remote"])
def test_a_weak_run_is_warned_of_wherever_its_record_is(
    toy_store: Store,
    server: Server,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    way: str,
) -> None:
    if "few" not in toy_store:
        of = demonstrations()
        few = [Episode(of.states[:30], of.actions[:30], labeled=number < 1) for number in range(3)]
        made = toy_store.create("few", few, state_names=["place", "goal"], action_names=["move"])
        score(made, VAE(steps=5), run="vae")
    weak = toy_store["few"].runs["vae"].weak
    assert weak and not toy_store["toy"].runs["vae"].weak
    if way == "store":
        monkeypatch.setitem(sys.modules, "ssil_service", None)
    place = StoreLocation(toy_store.folder.uri)
    url = server.url if way == "remote" else None
    for dataset, expected in (("few", f"Weak: vae: {'; '.join(weak)}\n"), ("toy", "")):
        source = DataSource(dataset, run="vae", service=url)
        with load_training_data(source, "ssil", place):
            assert capsys.readouterr().err == expected


def test_a_service_killed_and_restarted_in_the_middle_changes_no_byte(
    toy_store: Store,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    expected = undisturbed(toy_store, tmp_path / "alone")
    servers = [launch(toy_store.folder.uri)]
    port = int(servers[0].url.rpartition(":")[2])
    killed = Event()

    def restart() -> None:
        killed.wait()
        time.sleep(1.5)
        servers.append(launch(toy_store.folder.uri, port=port))

    def kill(row: HistoryRow) -> None:
        if row.steps == SETTINGS.steps // 2:
            servers[0].kill()
            killed.set()

    thread = Thread(target=restart)
    thread.start()
    try:
        with open_store(StoreLocation(toy_store.folder.uri), servers[0].url) as store:
            train_toy(TrainingData.read(store["toy"], "vae"), tmp_path / "cut", callback=kill)
    finally:
        killed.set()
        thread.join()
        for each in servers:
            each.kill()
    assert files(tmp_path / "cut") == expected
    assert len(servers) == 2
    printed = capsys.readouterr().err
    assert printed.count(f"Waiting for {servers[0].url}") == 1


class Troubled(httpx.BaseTransport):
    """A service that is busy, loses answers after computing them, or cannot be reached."""

    def __init__(self, inner: httpx.BaseTransport) -> None:
        self.inner = inner
        self.queries = 0
        self.troubles = 0

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        if not request.url.path.endswith("lcor"):
            return self.inner.handle_request(request)
        self.queries += 1
        trouble = {1: self._busy, 2: self._lost, 3: self._away}.get(self.queries % 4)
        if trouble is None:
            return self.inner.handle_request(request)
        self.troubles += 1
        return trouble(request)

    def _busy(self, request: httpx.Request) -> httpx.Response:
        return httpx.Response(503, headers={"Retry-After": "0"}, json={"detail": "queue full"})

    def _lost(self, request: httpx.Request) -> httpx.Response:
        self.inner.handle_request(request).read()
        raise httpx.ReadError("connection reset")

    def _away(self, request: httpx.Request) -> httpx.Response:
        raise httpx.ConnectError("connection refused")

    def close(self) -> None:
        self.inner.close()


def test_a_busy_service_and_lost_answers_change_no_byte(toy_store: Store, tmp_path: Path) -> None:
    expected = undisturbed(toy_store, tmp_path / "alone")
    app = create_app(read_settings(store=toy_store.folder.uri, state=tmp_path / "state"))
    troubled = Troubled(EmbeddedTransport(app))
    quick = RetryPolicy(first=0.001, longest=0.002, total=5.0)
    with connect("http://localhost", transport=troubled, retry=quick) as store:
        train_toy(TrainingData.read(store["toy"], "vae"), tmp_path / "cut")
    assert files(tmp_path / "cut") == expected
    assert (troubled.queries, troubled.troubles) == (4 * ITERATIONS, 3 * ITERATIONS)


def refusal(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    with pytest.raises(SystemExit) as left:
        main([str(word) for word in words])
    assert left.value.code == 2
    return capsys.readouterr().err


def test_a_run_whose_service_does_not_come_back_can_be_resumed(
    toy_store: Store,
    server: Server,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    gone = launch(toy_store.folder.uri, environment={"SSIL_READ_KEY": KEY})
    monkeypatch.setattr(serving, "CONNECT_TIMEOUT", 0.3)
    monkeypatch.setattr(serving, "RETRY_TIMEOUT", 0.3)
    monkeypatch.setattr(command, "make_vectorized", lambda env, count: LineEnv(count))
    words = ["train", "ssil", "--env", "Pendulum-v1", "--dataset", "toy", "--run", "vae"]
    words += ["--environments", 4, "--horizon", STEPS, "--hidden", 8, "--boundary", 2]
    words += ["--steps", SETTINGS.steps, "--evaluations", 2, "-o", tmp_path / "out"]
    whole_run = TrainRun.train

    def stop_service_after(iteration: int) -> Callable[..., TrainResult]:
        def cut_run(run: TrainRun, *, resume: bool, callback: Callback) -> TrainResult:
            def both(row: HistoryRow) -> None:
                callback(row)
                if row.iteration is not None and row.iteration.number == iteration:
                    gone.kill()

            return whole_run(run, resume=resume, callback=both)

        return cut_run

    monkeypatch.setattr(TrainRun, "train", stop_service_after(5))
    assert "key:" in refusal(capsys, *words, "--service", gone.url)
    monkeypatch.setenv(serving.API_KEY_VARIABLE, KEY)
    message = refusal(capsys, *words, "--service", gone.url)
    assert "--resume goes on" in message and str(tmp_path / "out") in message
    message = refusal(capsys, *words, "--resume", "--service", gone.url)
    assert f"no answer from {gone.url}" in message

    monkeypatch.setattr(TrainRun, "train", whole_run)
    monkeypatch.delenv(serving.API_KEY_VARIABLE)
    for folder, more in (("out", ["--resume"]), ("whole", [])):
        with pytest.raises(SystemExit) as left:
            main([str(w) for w in [*words[:-1], tmp_path / folder, "--service", server.url, *more]])
        assert left.value.code == 0
    assert files(tmp_path / "out") == files(tmp_path / "whole")
