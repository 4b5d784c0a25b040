"""Mixtures with a known share of experts and few labels, from the committed sets and from others'.

Every mixture is drawn by its seed: which drives give the labels and where in them they begin, and
which expert drives are left among the unlabeled ones.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Episode
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset

ROOT = Path(__file__).parents[2]
DATASETS = ROOT / "datasets"
OTHERS = ROOT.parent / "shared" / "data"

RACETRACK = {0.5: 24_000, 0.09: 2_400, 0.024: 600}
"""Expert pairs beside 24,000 negative ones, by the share of the unlabeled pairs that they are: .5,
.0909 and .0244, rounded. They are not the RC car's, whose small ones are .1 and .04."""

RC = {0.63: 2_005, 0.5: 1_170, 0.1: 130, 0.04: 49}
"""Expert pairs beside 1,170 negative ones, by the share of the unlabeled pairs that they are: .631,
.5, .1 and .0402, rounded. The first is the committed set's."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of pairs with their episodes, and what is known of each.

    Parameters
    ----------
    states, actions
        (n, d) and (n, k).
    episode
        Number of each row's episode, (n,).
    expert
        Whether each row is the expert's, (n,).
    value
        True quality of each row's episode, (n,); None where only `expert` is known.
    """

    states: NDArray[np.float32]
    actions: NDArray[np.float32]
    episode: NDArray[np.int64]
    expert: NDArray[np.bool_]
    value: NDArray[np.float64] | None = None

    def drive(self, number: int) -> NDArray[np.int64]:
        """Return the rows of an episode.

        Parameters
        ----------
        number
            Of the episode.
        """
        return np.flatnonzero(self.episode == number)


def build(
    store: Store, name: str, rows: Rows, labeled: list[NDArray], rest: list[NDArray]
) -> Dataset:
    """Write a mixture as a dataset.

    Parameters
    ----------
    store, name
        Where to.
    rows
        All rows.
    labeled, rest
        Rows of each labeled and of each unlabeled episode.
    """

    def episodes():
        for is_labeled, parts in ((True, labeled), (False, rest)):
            for part in parts:
                yield Episode(
                    states=rows.states[part],
                    actions=rows.actions[part],
                    labeled=is_labeled,
                    score=None if rows.value is None else float(rows.value[part[0]]),
                    tier="expert" if rows.expert[part[0]] else "0-other",
                )

    return store.create(
        name,
        episodes(),
        state_names=[f"s{index}" for index in range(rows.states.shape[1])],
        action_names=[f"a{index}" for index in range(rows.actions.shape[1])],
    )


def racetrack(store: Store, name: str, *, seed: int, labels: int, share: float) -> Dataset:
    """Make a mixture of the racetrack: labels are pairs in a row of as few drives as give them.

    Parameters
    ----------
    store, name
        Where to.
    seed
        Draws drives and starts.
    labels
        Labeled pairs.
    share
        A key of `RACETRACK`.
    """
    rows = _read_committed("racetrack")
    source = Store(str(DATASETS))["racetrack"]
    known = source.per_pair("labeled").astype(bool)
    random = np.random.default_rng([seed, labels, RACETRACK[share]])
    of_experts = random.permutation(np.unique(rows.episode[rows.expert & ~known]))
    of_labels = random.permutation(np.unique(rows.episode[known]))
    labeled = _draw_stretches(rows, of_labels, labels, random)
    experts = _take_first(rows, of_experts, RACETRACK[share])
    others = [rows.drive(number) for number in np.unique(rows.episode[~rows.expert])]
    return build(store, name, rows, labeled, experts + others)


def rc_lidar(store: Store, name: str, *, seed: int, labels: int, share: float) -> Dataset:
    """Make a mixture of the RC car: labels from one drive or more, which leave the pool.

    Parameters
    ----------
    store, name
        Where to.
    seed
        Draws drives and starts.
    labels
        Labeled pairs; a lap is 401.
    share
        A key of `RC`.
    """
    rows = _read_committed("rc-lidar")
    random = np.random.default_rng([seed, labels])
    drives = random.permutation(np.unique(rows.episode[rows.expert]))
    labeled = _draw_stretches(rows, drives, labels, random)
    rest = drives[len(labeled) :]
    others = [rows.drive(number) for number in np.unique(rows.episode[~rows.expert])]
    return build(store, name, rows, labeled, _take_first(rows, rest, RC[share]) + others)


def pybullet(store: Store, name: str, *, seed: int, labels: int, task: str) -> Dataset:
    """Make a mixture of RIL-Co's HalfCheetah or Ant: all levels, labels from one expert episode.

    Parameters
    ----------
    store, name
        Where to.
    seed
        Draws episode and start.
    labels
        Labeled pairs.
    task
        `HalfCheetah` or `Ant`.
    """
    parts = []
    for path in sorted((OTHERS / "ril_co" / task).glob("*.h5")):
        states, actions, mask = _read_arrays(path, "obs_array", "act_array", "mask_array")
        ends = mask[:, 0] == 0
        episode = np.concatenate([[0], np.cumsum(ends[:-1])])
        parts.append((states, actions, episode, np.full(len(states), path.stem == "P1.0")))
    rows = _join(parts)
    random = np.random.default_rng([seed, labels])
    drives = random.permutation(np.unique(rows.episode[rows.expert]))
    labeled = _draw_stretches(rows, drives, labels, random)
    others = np.setdiff1d(np.unique(rows.episode), drives[: len(labeled)])
    return build(store, name, rows, labeled, [rows.drive(number) for number in others])


def cheetah(store: Store, name: str, *, seed: int, labels: int) -> Dataset:
    """Make 2IWIL's HalfCheetah mixture: single rows, labels of a confidence above .999.

    Parameters
    ----------
    store, name
        Where to.
    seed
        Draws the labeled rows.
    labels
        Labeled pairs.
    """
    both = np.load(OTHERS / "kristery" / "HalfCheetah-v2_mixture.npy").astype(np.float32)
    sure = np.load(OTHERS / "kristery" / "HalfCheetah-v2_mixture_conf.npy")[:, 0]
    rows = Rows(both[:, :17], both[:, 17:], np.arange(len(both)), sure > 0.5)
    random = np.random.default_rng([seed, labels])
    chosen = np.sort(random.permutation(np.flatnonzero(sure > 0.999))[:labels])
    rest = np.setdiff1d(np.arange(len(both)), chosen)
    return build(
        store, name, rows, [np.array([row]) for row in chosen], [np.array([row]) for row in rest]
    )


def pendulum(store: Store, name: str, *, seed: int, labels: int) -> Dataset:
    """Make VILD's Pendulum mixture: ten levels of action noise, labels whole expert episodes.

    Parameters
    ----------
    store, name
        Where to.
    seed
        Draws the labeled episodes.
    labels
        Labeled pairs, 200 an episode.
    """
    folder = OTHERS / "vild" / "Pendulum-v0"
    with (OTHERS / "vild" / "returns.csv").open() as file:
        table = [row for row in csv.DictReader(file) if row["env"] == "Pendulum-v0"]
    parts = []
    values: list[float] = []
    for stem in sorted({row["file"] for row in table}):
        states, actions = _read_arrays(folder / stem, "expert_states", "expert_actions")
        returns = [float(row["return"]) for row in table if row["file"] == stem]
        episode = np.arange(len(states)) // 200
        parts.append((states, actions, episode, np.full(len(states), "normal0.00" in stem)))
        values += returns
    joined = _join(parts)
    rows = Rows(
        joined.states,
        joined.actions,
        joined.episode,
        joined.expert,
        np.array(values)[joined.episode],
    )
    random = np.random.default_rng([seed, labels])
    drives = random.permutation(np.unique(rows.episode[rows.expert]))[: labels // 200]
    rest = np.setdiff1d(np.unique(rows.episode), drives)
    return build(
        store,
        name,
        rows,
        [rows.drive(each) for each in drives],
        [rows.drive(each) for each in rest],
    )


def _read_arrays(path: Path, *names: str) -> list[NDArray]:
    """Read arrays of an HDF5 file."""
    import h5py  # not needed for the committed sets

    with h5py.File(path) as file:
        return [np.asarray(file[name]) for name in names]


def _read_committed(name: str) -> Rows:
    """Read a committed dataset."""
    source = Store(str(DATASETS))[name]
    pairs = source.pairs()
    tier = source.per_pair("tier")
    return Rows(pairs.states, pairs.actions, pairs.episode, tier == "expert")


def _join(parts: list[tuple[NDArray, ...]]) -> Rows:
    """Join parts, each with episodes from 0."""
    offsets = np.cumsum([0, *(part[2][-1] + 1 for part in parts)])
    return Rows(
        states=np.concatenate([part[0] for part in parts]).astype(np.float32),
        actions=np.concatenate([part[1] for part in parts]).astype(np.float32),
        episode=np.concatenate(
            [part[2] + first for part, first in zip(parts, offsets, strict=False)]
        ),
        expert=np.concatenate([part[3] for part in parts]),
    )


def _draw_stretches(
    rows: Rows, drives: NDArray[np.int64], count: int, random: np.random.Generator
) -> list[NDArray[np.int64]]:
    """Draw pairs in a row from one drive after the other until there are enough."""
    stretches = []
    for number in drives:
        drive = rows.drive(number)
        length = min(count, len(drive))
        first = random.integers(0, len(drive) - length + 1)
        stretches.append(drive[first : first + length])
        count -= length
        if not count:
            return stretches
    raise ValueError("too few pairs to draw from")


def _take_first(rows: Rows, drives: NDArray[np.int64], count: int) -> list[NDArray[np.int64]]:
    """Take whole drives until there are enough pairs; the last is cut."""
    taken: list[NDArray[np.int64]] = []
    for number in drives:
        if count <= 0:
            break
        part = rows.drive(number)[:count]
        taken.append(part)
        count -= len(part)
    return taken


MAKERS: dict[str, Callable[..., Dataset]] = {
    "racetrack": racetrack,
    "rc-lidar": rc_lidar,
    "pybullet": pybullet,
    "cheetah": cheetah,
    "pendulum": pendulum,
}
"""Every kind of mixture."""
