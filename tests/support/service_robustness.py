"""Strangers and power cuts, many of them: mutated bodies, and kills during jobs and writes.

    python tests/support/service_robustness.py mutations 10000
    python tests/support/service_robustness.py kills 50

Exit status 1, with what was found, if a mutated body got a 5xx or ended a process, if anything
acknowledged was lost, or if anything torn was seen.
"""

from __future__ import annotations

import io
import random
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

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


def question(rows: int) -> pa.Table:
    """Pairs as the body of a question."""
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
    """Pairs as an upload, with text, a dictionary and lists of varying type."""
    table = question(rows)
    text = pa.array([f"lap {row // 4}" for row in range(rows)])
    lists = pa.array(table["state"].to_pylist(), pa.list_(pa.float64()))
    return (
        table.set_column(2, "state", lists)
        .set_column(0, "episode", text.dictionary_encode())
        .append_column("tier", text)
    )


def parquet(table: pa.Table) -> bytes:
    """Return a table as a Parquet file."""
    sink = io.BytesIO()
    pq.write_table(table, sink)
    return sink.getvalue()


def mutated(body: bytes, chance: random.Random) -> bytes:
    """Damage a body in one to four places."""
    data = bytearray(body)
    for _ in range(chance.randint(1, 4)):
        place = chance.randrange(len(data)) if data else 0
        kind = chance.randrange(6)
        if kind == 0:
            data[place : place + 1] = bytes([chance.randrange(256)])
        elif kind == 1:
            data[place : place + 1] = bytes([data[place] ^ 1 << chance.randrange(8)])
        elif kind == 2:
            size = chance.choice([4, 8])
            extreme = chance.choice([0, 1, -1, 2**31 - 1, -(2**31), 2**30, 255, 65_536])
            place -= place % size
            data[place : place + size] = extreme.to_bytes(size, "little", signed=True)
        elif kind == 3:
            del data[place : place + chance.randint(1, 64)]
        elif kind == 4:
            data[place:place] = data[place : place + chance.randint(1, 64)]
        else:
            del data[chance.randrange(max(1, len(data) // 2), len(data) + 1) :]
        if not data:
            break
    return bytes(data)


def mutations(count: int) -> list[str]:
    """Send mutated bodies; return what went wrong."""
    chance, statuses, wrong = random.Random(0), Counter[Any](), []
    shapes = [(question, "POST", "lcor"), (question, "POST", "score"), (upload, "PUT", "upload")]
    bodies = {
        (make, media): [form(make(rows)) for rows in (1, 7, 60)]
        for make in (question, upload)
        for media, form in ((ARROW, lambda t: encode(t).to_pybytes()), (PARQUET, parquet))
    }
    deaths = 0
    with tempfile.TemporaryDirectory() as folder:
        store = small_store(Path(folder) / "store")
        server = launch(store, "--decoded-bytes", str(2**28))
        with httpx.Client(base_url=server.url, timeout=60) as http:
            for number in range(count):
                make, method, what = chance.choices(shapes, (5, 3, 2))[0]
                media = chance.choice([ARROW, PARQUET])
                body = mutated(chance.choice(bodies[make, media]), chance)
                path = f"v1/datasets/walks/runs/vae/{what}" if method == "POST" else "v1/datasets/m"
                try:
                    answer = http.request(
                        method, path, content=body, headers={"Content-Type": media}
                    )
                except httpx.HTTPError as error:
                    wrong.append(f"case {number}: {method} {path} {media}: {error!r}")
                    if server.process.poll() is not None:
                        wrong.append(f"the server ended with {server.process.returncode}")
                        break
                    continue
                deaths += "dies of" in answer.text
                statuses[what, media.rpartition(".")[2], answer.status_code] += 1
                if answer.status_code >= 500:
                    wrong.append(f"case {number}: {method} {path} {media}: {answer.text}")
                if answer.status_code == 201:
                    http.delete(path)
            alive = http.get("readyz").status_code == 200
        server.kill()
        damaged = sd.Store(store)["walks"].find_damage()
    print(f"{count} mutated bodies; the server lived: {alive}; workers that died of one: {deaths}")
    for (what, media, status), times in sorted(statuses.items()):
        print(f"  {what:>7} {media:>8} {status}: {times:,}")
    return [*wrong, *damaged]


# kills


_FLAGS = ("--jobs", "1", "--job-queue", "1")
_LONG = 500


class Load:
    """Clients that upload, append and start jobs, and remember what was acknowledged."""

    def __init__(self, server: Server, round_number: int) -> None:
        self.uploaded: list[str] = []
        self.appended: list[str] = []
        self.finished: list[tuple[str, str]] = []
        self.accepted: list[str] = []
        self.warm = threading.Event()
        self._stop = threading.Event()
        self._server, self._round = server, round_number
        work = (self._upload, self._append, self._score, self._watch)
        self._threads = [threading.Thread(target=each, daemon=True) for each in work]
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Wait for the clients, whose server is gone."""
        self._stop.set()
        for thread in self._threads:
            thread.join()

    def _upload(self) -> None:
        body, number = encode(upload(3_000)).to_pybytes(), 0
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
                    self.warm.set()

    def _append(self) -> None:
        number = 0
        with httpx.Client(base_url=self._server.url, timeout=30) as http:
            while not self._stop.is_set():
                added = appended(self._round, number)
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
        body, number = {"estimator": {"kind": "vae", "steps": 5}}, 0
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


def appended(round_number: int, number: int) -> sd.Episode:
    """Return an episode that is told from all others by its source and by each of its pairs."""
    states = np.full((_LONG, 3), (round_number, number, 0.5))
    return sd.Episode(states, states[:, :2], source=f"{round_number} {number}")


def kills(rounds: int) -> list[str]:
    """Kill a service under load, again and again; return what was lost or torn."""
    chance, wrong, done = random.Random(0), [], Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        store = small_store(Path(folder) / "store")
        sd.Store(store).create("grows", [appended(0, 0)], **NAMES)
        uploaded: set[str] = set()
        added = Counter[str]()
        accepted: set[str] = set()
        finished: set[str] = set()
        for number in range(1, rounds + 1):
            server = launch(store, *_FLAGS, log=Path(folder) / "log")
            with httpx.Client(base_url=server.url, timeout=30) as http:
                known = {job["job"] for job in http.get("v1/jobs").json()["jobs"]}
            lost = accepted - known
            wrong += [f"round {number}: job {job} was accepted and is not known" for job in lost]
            load = Load(server, number)
            load.warm.wait(60)
            time.sleep(chance.uniform(0.0, 5.0))
            server.kill()
            load.stop()
            uploaded |= set(load.uploaded)
            added.update(load.appended)
            accepted |= set(load.accepted)
            finished |= {run for _, run in load.finished}
            found = [*seen_wrong(store, uploaded, finished), *grown_wrong(store, added)]
            wrong += [f"round {number}: {each}" for each in found]
            done += Counter(uploads=len(load.uploaded), jobs=len(load.accepted))
        unknown = len(sd.Store(store)["grows"].episodes) - 1 - added.total()
        print(f"  appends that were made and not acknowledged: {unknown}")
        done += Counter(appends=added.total(), runs=len(finished))
        server = launch(store, "--jobs", "2")
        wrong += [f"at the end: {each}" for each in unfinished(server, accepted)]
        server.kill()
        wrong += [*seen_wrong(store, uploaded, finished), *grown_wrong(store, added)]
    print(f"{rounds} kills; acknowledged: {dict(done)}; lost or torn: {len(wrong)}")
    return wrong


def seen_wrong(store: Path, uploaded: set[str], finished: set[str]) -> list[str]:
    """Read the store as any process would, right after a kill."""
    here = sd.Store(store)
    names = set(here.names())
    wrong = [f"{name} was acknowledged and is lost" for name in uploaded - names]
    for name in names - {"walks", "grows"}:
        dataset = here[name]
        if len(dataset) != 3_000 or len(dataset.pairs()) != 3_000:
            wrong.append(f"{name} is torn: {len(dataset)} pairs")
    walks = here["walks"]
    wrong += walks.find_damage()
    wrong += [f"run {run} was shown and is lost" for run in finished - set(walks.runs.names())]
    for run in walks.runs.names():
        if len(walks.leverage(run)) != 240:
            wrong.append(f"run {run} is torn")
    return wrong


def grown_wrong(store: Path, acknowledged: Counter[str]) -> list[str]:
    """Tell which appends are lost, were made twice, or made in part."""
    grows = sd.Store(store)["grows"]
    pairs, sources = grows.pairs(), grows.episodes["source"].to_pylist()
    made = Counter(sources[1:])
    wrong = [f"append {each} was acknowledged and is lost" for each in acknowledged - made]
    wrong += [f"append {each} was made {times} times" for each, times in made.items() if times > 1]
    expected = np.array([[float(number) for number in each.split()] for each in sources])
    if not np.array_equal(pairs.states[:, :2], expected.repeat(_LONG, axis=0)):
        wrong.append(f"grows is torn: {len(pairs)} pairs in {len(sources)} episodes")
    return [*wrong, *grows.find_damage()]


def unfinished(server: Server, accepted: set[str]) -> list[str]:
    """Wait until the last server has ended every job that was accepted."""
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
    open_ = [
        f"job {job} is {states[job]}" for job in states if states[job] in ("queued", "running")
    ]
    return [*lost, *open_]


def main() -> int:
    """Run what the command line asks for."""
    what, count = sys.argv[1], int(sys.argv[2])
    wrong = {"mutations": mutations, "kills": kills}[what](count)
    print("\n".join(wrong[:50]))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
