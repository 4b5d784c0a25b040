"""Many mutated bodies, and many kills during jobs and writes.

    python tests/support/service_robustness.py mutations 10000
    python tests/support/service_robustness.py kills 50

Exit status 1, with what was found, if a mutated body got a 5xx or ended the server, if anything
acknowledged was lost, or if anything half written was seen.
"""

from __future__ import annotations

import io
import random
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import httpx
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import ssil_data as sd
from ssil_data.client.upload import episodes_body
from ssil_data.client.wire import ARROW, PARQUET, encode, rows_of_matrix
from ssil_service.server.launch import Server, launch

NAMES = {"state_names": ["x", "y", "z"], "action_names": ["a", "b"]}


def small_store(folder: Path) -> Path:
    """Make a store with a dataset `walks` and its run `vae`."""
    rng = np.random.default_rng(0)
    walks = [
        sd.Episode(rng.normal(size=(40, 3)), rng.normal(size=(40, 2)), labeled=number < 2)
        for number in range(6)
    ]
    sd.score(sd.Store(folder).create("walks", walks, **NAMES), sd.VAE(steps=5), run="vae")
    return folder


# mutations


def query(rows: int) -> pa.Table:
    """Return pairs as the body of a query."""
    rng = np.random.default_rng(rows)
    return pa.table(
        {
            "episode": np.zeros(rows, np.int64),
            "step": np.arange(rows),
            "state": rows_of_matrix(rng.normal(size=(rows, 3)).astype(np.float32)),
            "action": rows_of_matrix(rng.normal(size=(rows, 2)).astype(np.float32)),
        }
    )


def upload(rows: int) -> pa.Table:
    """Return pairs as an upload, with text, a dictionary and lists of varying type."""
    table = query(rows)
    text = pa.array([f"lap {row // 4}" for row in range(rows)])
    lists = pa.array(table["state"].to_pylist(), pa.list_(pa.float64()))
    return (
        table.set_column(2, "state", lists)
        .set_column(0, "episode", text.dictionary_encode())
        .append_column("tier", text)
    )


def encode_parquet(table: pa.Table) -> bytes:
    """Return a table as a Parquet file."""
    sink = io.BytesIO()
    pq.write_table(table, sink)
    return sink.getvalue()


def mutate(body: bytes, random_: random.Random) -> bytes:
    """Damage a body in one to four places."""
    data = bytearray(body)
    for _ in range(random_.randint(1, 4)):
        start = random_.randrange(len(data)) if data else 0
        kind = random_.randrange(6)
        if kind == 0:  # another byte
            data[start : start + 1] = bytes([random_.randrange(256)])
        elif kind == 1:  # one bit flipped
            data[start : start + 1] = bytes([data[start] ^ 1 << random_.randrange(8)])
        elif kind == 2:  # an extreme number
            size = random_.choice([4, 8])
            extreme = random_.choice([0, 1, -1, 2**31 - 1, -(2**31), 2**30, 255, 65_536])
            start -= start % size
            data[start : start + size] = extreme.to_bytes(size, "little", signed=True)
        elif kind == 3:  # a part removed
            del data[start : start + random_.randint(1, 64)]
        elif kind == 4:  # a part repeated
            data[start:start] = data[start : start + random_.randint(1, 64)]
        else:  # cut off
            del data[random_.randrange(max(1, len(data) // 2), len(data) + 1) :]
        if not data:
            break
    return bytes(data)


@dataclass(frozen=True)
class Target:
    """A kind of request whose body is mutated."""

    make_table: Callable[[int], pa.Table]
    method: str
    path: str

    @property
    def name(self) -> str:
        """The last word of the path."""
        return self.path.rpartition("/")[2]


_RUN = "v1/datasets/walks/runs/vae"
_TARGETS = (
    Target(query, "POST", f"{_RUN}/lcor"),
    Target(query, "POST", f"{_RUN}/score"),
    Target(upload, "PUT", "v1/datasets/mutated"),
)
_WEIGHTS = (5, 3, 2)
_ENCODERS = {ARROW: lambda table: encode(table).to_pybytes(), PARQUET: encode_parquet}


class Mutations:
    """Sends mutated bodies to a server, and counts and remembers what happens."""

    def __init__(self, server: Server) -> None:
        self.faults: list[str] = []
        self.statuses = Counter[tuple[str, str, int]]()
        self.crashes = 0
        self._server = server
        self._random = random.Random(0)
        self._bodies = {
            (make_table, media): [encoder(make_table(rows)) for rows in (1, 7, 60)]
            for make_table in (query, upload)
            for media, encoder in _ENCODERS.items()
        }

    def send(self, http: httpx.Client, number: int) -> None:
        """Send one mutated body."""
        target = self._random.choices(_TARGETS, _WEIGHTS)[0]
        media = self._random.choice([ARROW, PARQUET])
        body = mutate(self._random.choice(self._bodies[target.make_table, media]), self._random)
        case = f"case {number}: {target.method} {target.path} {media}"
        try:
            answer = http.request(
                target.method, target.path, content=body, headers={"Content-Type": media}
            )
        except httpx.HTTPError as error:
            self.faults.append(f"{case}: {error!r}")
            return
        self.crashes += "crashes the parser" in answer.text
        self.statuses[target.name, media.rpartition(".")[2], answer.status_code] += 1
        if answer.status_code >= 500:
            self.faults.append(f"{case}: {answer.text}")
        if answer.status_code == 201:
            http.delete(target.path)

    @property
    def server_has_ended(self) -> bool:
        """Whether the server's process ended."""
        return self._server.process.poll() is not None


def run_mutations(count: int) -> list[str]:
    """Send mutated bodies; return what went wrong."""
    with tempfile.TemporaryDirectory() as folder:
        store = small_store(Path(folder) / "store")
        server = launch(store, "--decoded-bytes", str(2**28))
        mutations = Mutations(server)
        with httpx.Client(base_url=server.url, timeout=60) as http:
            for number in range(count):
                mutations.send(http, number)
                if mutations.server_has_ended:
                    mutations.faults.append(f"the server ended: {server.process.returncode}")
                    break
            ready = not mutations.server_has_ended and http.get("readyz").status_code == 200
        server.kill()
        damage = sd.Store(store)["walks"].find_damage()
    if not ready:
        mutations.faults.append("the server was not ready at the end")
    print(f"{count} mutated bodies; server ready: {ready}; crashed workers: {mutations.crashes}")
    for (name, media, status), times in sorted(mutations.statuses.items()):
        print(f"  {name:>7} {media:>8} {status}: {times:,}")
    return [*mutations.faults, *damage]


# kills


_FLAGS = ("--jobs", "1", "--job-queue", "1")
_STEPS = 500
"""Steps of an episode that is appended."""


class Load:
    """Clients that upload, append and start jobs, and remember what was acknowledged."""

    def __init__(self, server: Server, round_number: int) -> None:
        self.uploaded: list[str] = []
        self.appended: list[str] = []
        self.finished: list[tuple[str, str]] = []
        self.accepted: list[str] = []
        self.started = threading.Event()
        self._stop = threading.Event()
        self._server = server
        self._round = round_number
        clients = (self._upload, self._append, self._score, self._watch)
        self._threads = [threading.Thread(target=each, daemon=True) for each in clients]
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Wait for the clients, after their server was killed."""
        self._stop.set()
        for thread in self._threads:
            thread.join()

    def _upload(self) -> None:
        body = encode(upload(3_000)).to_pybytes()
        number = 0
        with httpx.Client(base_url=self._server.url, timeout=30) as http:
            while not self._stop.is_set():
                name = f"up-{self._round}-{number}"
                number += 1
                try:
                    answer = http.put(
                        f"v1/datasets/{name}", content=body, headers={"Content-Type": ARROW}
                    )
                except httpx.HTTPError:
                    return
                if answer.status_code == 201:
                    self.uploaded.append(name)
                    self.started.set()

    def _append(self) -> None:
        number = 0
        with httpx.Client(base_url=self._server.url, timeout=30) as http:
            while not self._stop.is_set():
                added = episode_to_append(self._round, number)
                body = episodes_body([added], NAMES["state_names"], NAMES["action_names"], "")
                number += 1
                try:
                    answer = http.post(
                        "v1/datasets/grows/episodes", content=body, headers={"Content-Type": ARROW}
                    )
                except httpx.HTTPError:
                    return
                if answer.status_code == 201:
                    self.appended.append(str(added.source))

    def _score(self) -> None:
        body = {"estimator": {"kind": "vae", "steps": 5}}
        number = 0
        with httpx.Client(base_url=self._server.url, timeout=30) as http:
            while not self._stop.is_set():
                name = f"run-{self._round}-{number}"
                number += 1
                try:
                    answer = http.post("v1/datasets/walks/runs", json={**body, "run": name})
                except httpx.HTTPError:
                    return
                if answer.status_code == 202:
                    self.accepted.append(answer.json()["job"])
                time.sleep(0.3)

    def _watch(self) -> None:
        with httpx.Client(base_url=self._server.url, timeout=30) as http:
            while not self._stop.is_set():
                try:
                    jobs = http.get("v1/jobs").json()["jobs"]
                except httpx.HTTPError:
                    return
                for job in jobs:
                    if job["state"] == "succeeded":
                        self.finished.append((job["job"], job["run"]))
                time.sleep(0.05)


def episode_to_append(round_number: int, number: int) -> sd.Episode:
    """Return an episode that its source and each of its pairs identify."""
    states = np.full((_STEPS, 3), (round_number, number, 0.5))
    return sd.Episode(states, states[:, :2], source=f"{round_number} {number}")


class Acknowledged:
    """What servers acknowledged before they were killed, over all rounds."""

    def __init__(self) -> None:
        self.uploads: set[str] = set()
        self.appends = Counter[str]()
        self.jobs: set[str] = set()
        self.runs: set[str] = set()

    def add(self, load: Load) -> None:
        """Add what the clients of one round saw."""
        self.uploads |= set(load.uploaded)
        self.appends.update(load.appended)
        self.jobs |= set(load.accepted)
        self.runs |= {run for _, run in load.finished}


def run_kills(rounds: int) -> list[str]:
    """Kill a service under load, again and again; return what was lost or half written."""
    random_ = random.Random(0)
    acknowledged = Acknowledged()
    faults: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        store = small_store(Path(folder) / "store")
        sd.Store(store).create("grows", [episode_to_append(0, 0)], **NAMES)
        for number in range(1, rounds + 1):
            server = launch(store, *_FLAGS, log=Path(folder) / "log")
            found = find_lost_jobs(server, acknowledged)
            load = Load(server, number)
            load.started.wait(60)
            time.sleep(random_.uniform(0.0, 5.0))
            server.kill()
            load.stop()
            acknowledged.add(load)
            found += find_losses(store, acknowledged)
            faults += [f"round {number}: {each}" for each in found]
        server = launch(store, "--jobs", "2")
        faults += [f"at the end: {each}" for each in wait_for_jobs(server, acknowledged.jobs)]
        server.kill()
        faults += find_losses(store, acknowledged)
        unknown = len(sd.Store(store)["grows"].episodes) - 1 - acknowledged.appends.total()
    print(f"{rounds} kills; lost or half written: {len(faults)}; acknowledged:")
    print(f"  {len(acknowledged.uploads)} uploads, {acknowledged.appends.total()} appends,")
    print(f"  {len(acknowledged.jobs)} jobs, {len(acknowledged.runs)} runs")
    print(f"  appends that were made and not acknowledged: {unknown}")
    return faults


def find_lost_jobs(server: Server, acknowledged: Acknowledged) -> list[str]:
    """Name the jobs that were accepted before and that a new server does not know."""
    with httpx.Client(base_url=server.url, timeout=30) as http:
        known = {job["job"] for job in http.get("v1/jobs").json()["jobs"]}
    return [f"job {job} was accepted and is not known" for job in acknowledged.jobs - known]


def find_losses(store: Path, acknowledged: Acknowledged) -> list[str]:
    """Read the store as any process would after a kill; name what is lost or half written."""
    return [
        *check_uploads(store, acknowledged.uploads),
        *check_runs(store, acknowledged.runs),
        *check_appends(store, acknowledged.appends),
    ]


def check_uploads(store: Path, acknowledged: set[str]) -> list[str]:
    """Name uploads that are lost or half written."""
    opened = sd.Store(store)
    names = set(opened.names())
    faults = [f"{name} was acknowledged and is lost" for name in acknowledged - names]
    for name in names - {"walks", "grows"}:
        dataset = opened[name]
        if len(dataset) != 3_000 or len(dataset.pairs()) != 3_000:
            faults.append(f"{name} is half written: {len(dataset)} pairs")
    return faults


def check_runs(store: Path, acknowledged: set[str]) -> list[str]:
    """Name runs that are lost or half written."""
    walks = sd.Store(store)["walks"]
    names = walks.runs.names()
    faults = [f"run {run} was shown and is lost" for run in acknowledged - set(names)]
    faults += [f"run {run} is half written" for run in names if len(walks.leverage(run)) != 240]
    return [*faults, *walks.find_damage()]


def check_appends(store: Path, acknowledged: Counter[str]) -> list[str]:
    """Name appends that are lost, were made twice, or are half written."""
    grows = sd.Store(store)["grows"]
    pairs = grows.pairs()
    sources = grows.episodes["source"].to_pylist()
    found = Counter(sources[1:])
    faults = [f"append {each} was acknowledged and is lost" for each in acknowledged - found]
    faults += [f"append {each} was made {n} times" for each, n in found.items() if n > 1]
    expected = np.array([[float(number) for number in each.split()] for each in sources])
    if not np.array_equal(pairs.states[:, :2], expected.repeat(_STEPS, axis=0)):
        faults.append(f"grows is half written: {len(pairs)} pairs in {len(sources)} episodes")
    return [*faults, *grows.find_damage()]


def wait_for_jobs(server: Server, accepted: set[str]) -> list[str]:
    """Wait until a server has ended every job; name those that it lost or that did not end."""
    deadline = time.monotonic() + 300
    states: dict[str, str] = {}
    with httpx.Client(base_url=server.url, timeout=30) as http:
        while time.monotonic() < deadline:
            jobs = http.get("v1/jobs").json()["jobs"]
            states = {job["job"]: job["state"] for job in jobs}
            if not {"queued", "running"} & set(states.values()):
                break
            time.sleep(0.2)
    print(f"  jobs at the end: {dict(Counter(states.values()))}")
    lost = [f"job {job} is not known" for job in accepted - set(states)]
    unfinished = [
        f"job {job} is {state}" for job, state in states.items() if state in ("queued", "running")
    ]
    return [*lost, *unfinished]


def main() -> int:
    """Run what the command line names, as often as it says."""
    runs = {"mutations": run_mutations, "kills": run_kills}
    faults = runs[sys.argv[1]](int(sys.argv[2]))
    print("\n".join(faults[:50]))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
