"""One list of expectations for a store, whether it is a folder or behind a service."""

from __future__ import annotations

import inspect
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import ssil_data as sd
from ssil_data import surface
from ssil_data.client import RemoteDataset, RemoteField, RemoteModel, RemoteRuns, RemoteStore
from ssil_data.client import dataset as client_dataset
from ssil_data.field import LeverageField
from ssil_data.scoring import pipeline
from ssil_data.store import Dataset, Runs, Store
from ssil_data.surface import DatasetLike, FieldLike, ModelLike, RunsLike, StoreLike
from ssil_service import embed
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives

NAMES = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
PAIRS = ("states", "actions", "episode", "step")
POOLED = sd.Recipe(
    sd.Ensemble((sd.VAE(steps=10), sd.Contrast(steps=10))),
    sd.Posterior(),
    pooling=sd.Window(5),
    scale_floor=0.3,
    cross_fit=True,
)
BOTH = ["a folder", "behind a service"]

if TYPE_CHECKING:  # pyright holds both against the protocols here

    def _stores(local: Store, remote: RemoteStore) -> list[StoreLike[Any]]:
        one: StoreLike[Dataset] = local
        other: StoreLike[RemoteDataset] = remote
        return [one, other]

    def _datasets(local: Dataset, remote: RemoteDataset) -> list[DatasetLike]:
        return [local, remote]

    def _runs(local: Runs, remote: RemoteRuns) -> list[RunsLike]:
        return [local, remote]

    def _fields(local: LeverageField, remote: RemoteField) -> list[FieldLike]:
        return [local, remote]

    def _models(local: sd.LeverageModel, remote: RemoteModel) -> list[ModelLike]:
        return [local, remote]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with two versions of `drives`; the run `old` is the first's, the others the second's.

    `pooled` is by an ensemble, pooled over time.
    """
    folder = tmp_path_factory.mktemp("surface") / "store"
    first = sd.Store(folder).create("drives", drives(), card="# Drives", **NAMES)
    sd.score(first, sd.VAE(steps=10), run="old")
    second = first.append([drive(40, 12)])
    sd.score(second, sd.MDN(steps=10), run="mdn")
    sd.score(second, POOLED, run="pooled")
    return folder


@pytest.fixture(scope="module")
def truth(folder: Path) -> Dataset:
    """The dataset as the folder has it."""
    return sd.Store(folder)["drives"]


@pytest.fixture(scope="module", params=BOTH)
def store(request: pytest.FixtureRequest, folder: Path) -> Iterator[Any]:
    """The store, local and behind a service; no test changes it."""
    yield from _open(request.param, folder)


@pytest.fixture(scope="module")
def dataset(store: Any) -> Any:
    """The newest version of the dataset."""
    return store["drives"]


@pytest.fixture(params=BOTH)
def own(request: pytest.FixtureRequest, folder: Path, tmp_path: Path) -> Iterator[Any]:
    """A store of the test's own, local and behind a service."""
    yield from _open(request.param, Path(shutil.copytree(folder, tmp_path / "store")))


def _open(place: str, folder: Path) -> Iterator[Any]:
    if place == BOTH[0]:
        yield sd.Store(folder)
        return
    with embed(folder, jobs=1) as remote:
        yield remote


@pytest.mark.parametrize(
    ("protocol", "local", "remote"),
    [
        (surface.StoreLike, Store, RemoteStore),
        (surface.DatasetLike, Dataset, RemoteDataset),
        (surface.RunsLike, Runs, RemoteRuns),
        (surface.FieldLike, LeverageField, RemoteField),
        (surface.ModelLike, sd.LeverageModel, RemoteModel),
    ],
)
def test_members_take_the_same_arguments(protocol: type, local: type, remote: type):
    methods = [name for name, found in vars(protocol).items() if inspect.isfunction(found)]
    own = [name for name in methods if name not in ("__init__", "__subclasshook__")]
    assert own
    for name in own:
        expected = list(inspect.signature(getattr(protocol, name)).parameters)
        for kind in (local, remote):
            found = list(inspect.signature(getattr(kind, name)).parameters)
            assert found[: len(expected)] == expected, f"{kind.__name__}.{name}"


def test_a_store_lists_and_opens_its_datasets(store: Any):
    assert store.names() == ["drives"]
    assert [dataset.name for dataset in store] == ["drives"]
    assert "drives" in store
    assert "nope" not in store


def test_a_dataset_describes_itself(dataset: Any, truth: Dataset):
    for name in ("name", "version", "versions", "card", "state_names", "action_names"):
        assert getattr(dataset, name) == getattr(truth, name), name
    assert len(dataset) == len(truth) == 432
    assert dataset.episodes.equals(truth.episodes)
    assert dataset.card.startswith("# Drives")


def test_an_earlier_version_is_opened_by_its_fingerprint(dataset: Any, truth: Dataset):
    first, second = dataset.versions
    assert second == dataset.version
    earlier = dataset.at(first)
    assert (earlier.version, len(earlier), earlier.versions) == (first, 420, [first])
    assert dataset.at(second).version == second
    assert_array_equal(earlier.leverage("old"), truth.at(first).leverage("old"))


def test_pairs_are_read_whole_in_batches_by_episode_and_by_label(dataset: Any, truth: Dataset):
    for found, expected in (
        (dataset.pairs(), truth.pairs()),
        (dataset.episode(3), truth.episode(3)),
        (dataset.episode(11), truth.episode(11)),
        (dataset.labeled(), truth.labeled()),
    ):
        for name in PAIRS:
            assert_array_equal(getattr(found, name), getattr(expected, name))
            assert getattr(found, name).dtype == getattr(expected, name).dtype
    batches = list(dataset.batches(rows=100))
    assert max(map(len, batches)) <= 100
    assert_array_equal(np.concatenate([each.states for each in batches]), truth.pairs().states)


def test_columns_of_episodes_and_what_was_recorded(dataset: Any, truth: Dataset):
    for column in ("labeled", "source", "score", "tier"):
        assert_array_equal(dataset.per_pair(column), truth.per_pair(column))
    assert dataset.read_recorded("reward") is None
    assert dataset.read_recorded("position") is None


def test_what_was_recorded_of_every_pair_is_read(own: Any):
    walk = np.random.default_rng(0).normal(size=(9, 3)).astype(np.float32)
    episode = sd.Episode(walk, walk[:, :2], True, "a", walk[:, 0], walk[:, :2])
    made = own.create("recorded", [episode], **NAMES)
    assert_array_equal(made.read_recorded("reward"), walk[:, 0])
    assert_array_equal(made.read_recorded("position"), walk[:, :2])


def test_runs_are_listed_and_opened(dataset: Any, truth: Dataset):
    assert dataset.runs.names() == ["mdn", "old", "pooled"]
    assert [run.name for run in dataset.runs.all()] == ["old", "mdn", "pooled"]
    assert [run.name for run in dataset.runs] == ["mdn", "pooled"]
    assert dataset.runs["mdn"] == truth.runs["mdn"]
    assert dataset.runs["pooled"] == truth.runs["pooled"]
    assert dataset.runs.of_any_version("old") == truth.runs.of_any_version("old")
    for run in ("mdn", "pooled"):
        assert dataset.runs.values(run).equals(truth.runs.values(run))
    assert dataset.runs.values("pooled")["pooled"].null_count == 0
    assert dataset.runs.values("pooled")["contrast"].null_count == 0
    assert_array_equal(dataset.leverage("mdn"), truth.leverage("mdn"))


@pytest.mark.parametrize(
    "options",
    [{}, {"contributors": 3}, {"tolerance": 0.05}, {"tolerance": 0.5, "relative": True, "seed": 2}],
)
def test_lcor_is_the_folders_to_the_last_bit(options: dict[str, Any], dataset: Any, truth: Dataset):
    states = truth.pairs().states[::9]
    found = dataset.field("mdn").lcor(states, **options)
    expected = truth.field("mdn").lcor(states, **options)
    for name in ("values", "effective_sample_size", "half_width"):
        assert_array_equal(getattr(found, name), getattr(expected, name))
    assert_array_equal(found.contributors.row, expected.contributors.row)
    assert_array_equal(found.contributors.share, expected.contributors.share)


def test_lcor_in_a_time_limit_has_half_widths_that_hold(dataset: Any, truth: Dataset):
    states = truth.pairs().states[::9]
    found = dataset.field("mdn").lcor(states, seconds=5.0)
    expected = truth.field("mdn").lcor(states)
    assert (np.abs(found.values - expected.values) <= found.half_width + 1e-6).all()


def test_sums_and_cor_are_the_folders_to_the_last_bit(dataset: Any, truth: Dataset):
    states = truth.pairs().states[::9]
    found = dataset.field("mdn").sums(states, contributors=2)
    expected = truth.field("mdn").sums(states, contributors=2)
    for name in ("numerator", "denominator", "squares", "log_scale", "nearest", "nearest_weight"):
        assert_array_equal(getattr(found, name), getattr(expected, name))
    assert_array_equal(dataset.field("mdn").cor(states), truth.field("mdn").cor(states))


def test_another_alpha_is_another_field(dataset: Any, truth: Dataset):
    states = truth.pairs().states[::9]
    own = dataset.field("mdn")
    assert own.alpha == truth.field("mdn").alpha
    expected = truth.field("mdn", alpha=0.1 + 0.2).lcor(states).values
    for field in (own.at(0.1 + 0.2), dataset.field("mdn", alpha=0.1 + 0.2)):
        assert field.alpha == 0.1 + 0.2
        assert_array_equal(field.lcor(states).values, expected)
    assert (own.lcor(states).values != expected).any()


def test_a_model_gives_new_pairs_a_leverage(dataset: Any, truth: Dataset):
    new = drive(77, 15)
    pairs = sd.Pairs(new.states, new.actions, np.zeros(15, int), np.arange(15))
    for run in ("mdn", "old", "pooled"):
        found = dataset.model(run)(pairs)
        expected = truth.model(run)(pairs)
        assert_array_equal(found.leverage, expected.leverage)
        assert_array_equal(found.uncertainty, expected.uncertainty)
        assert_array_equal(found.pooled, expected.pooled)
        assert set(found.parts) == set(expected.parts)
        for part, values in expected.parts.items():
            assert_array_equal(found.parts[part], values)


def test_pairs_are_pooled_with_those_that_come_with_them(dataset: Any):
    new = drive(77, 15)
    number = np.arange(15)
    model = dataset.model("pooled")
    together = model(sd.Pairs(new.states, new.actions, np.zeros(15, int), number))
    alone = model(sd.Pairs(new.states, new.actions, number, np.zeros(15, int)))
    assert_array_equal(together.uncertainty, alone.uncertainty)
    assert_array_equal(alone.pooled.argsort(), alone.uncertainty.argsort())
    assert np.abs(together.pooled - alone.pooled).max() > 0.01


def test_runs_are_made_by_the_same_functions(own: Any, truth: Dataset):
    dataset = own["drives"]
    steps: list[tuple[str, int, int]] = []
    made = sd.score(
        dataset, sd.VAE(steps=10), seed=3, run="new", progress=lambda *step: steps.append(step)
    )
    assert (made.name, made.seed, made.dataset_version) == ("new", 3, dataset.version)
    assert steps[-1] == ("score", 432, 432)
    again = sd.rescore(dataset, dataset, "new", run="again")
    assert (again.name, again.model) == ("again", made.model)
    assert_array_equal(dataset.leverage("again"), dataset.leverage("new"))
    assert_array_equal(dataset.model("new")(truth.pairs()).leverage, dataset.leverage("new"))
    with pytest.raises(sd.ConflictError, match="new"):
        sd.score(dataset, sd.VAE(steps=10), run="new")
    with pytest.raises(sd.NotFoundError, match="run of drives"):
        sd.rescore(dataset, dataset, "nope")


def test_a_run_by_any_recipe_is_made_by_the_same_function(own: Any, truth: Dataset):
    dataset = own["drives"]
    made = sd.score(dataset, replace(POOLED, self_training=True), seed=4, run="made", labels=60)
    assert (made.labeled, made.self_training, made.cross_fit) == (60, True, True)
    assert made == dataset.runs["made"]
    assert_array_equal(dataset.model("made")(truth.pairs()).leverage, dataset.leverage("made"))
    again = sd.rescore(dataset, dataset, "pooled", run="again")
    assert (again.pooling, again.fitted_scale) == (
        truth.runs["pooled"].pooling,
        truth.runs["pooled"].fitted_scale,
    )
    assert_array_equal(dataset.leverage("again"), truth.leverage("pooled"))


def test_without_a_recipe_the_default_preset_is_meant(own: Any, monkeypatch: pytest.MonkeyPatch):
    for module in (pipeline, client_dataset):
        monkeypatch.setattr(module, "preset", lambda name: {"default": POOLED}[name])
    made = sd.score(own["drives"], seed=2)
    assert (made.name, sd.Recipe.of_run(made), made.seed) == ("ensemble", POOLED, 2)


def test_a_run_is_not_made_from_the_other_kind_of_store(folder: Path, truth: Dataset):
    with embed(folder, jobs=1) as remote:
        for dataset, source in ((truth, remote["drives"]), (remote["drives"], truth)):
            with pytest.raises(sd.InvalidInputError, match="source: "):
                sd.rescore(dataset, source, "mdn")  # pyright: ignore[reportCallIssue, reportArgumentType]


def test_a_dataset_is_written_extended_and_deleted(own: Any, tmp_path: Path):
    made = own.create("made", [drive(1, 9, labeled=True)], card="# Made", **NAMES)
    twin = sd.Store(tmp_path / "twin").create(
        "made", [drive(1, 9, labeled=True)], card="# Made", **NAMES
    )
    assert (made.version, made.card) == (twin.version, twin.card)
    longer = made.append([drive(2, 5)])
    assert (len(made), len(longer)) == (9, 14)
    assert longer.version == twin.append([drive(2, 5)]).version
    assert own["made"].version == longer.version
    own.delete("made")
    assert "made" not in own
    assert own.names() == ["drives"]


STATES = np.zeros((1, 3))
MISTAKES: dict[str, tuple[type[Exception], Callable[[Any], Any]]] = {
    "a dataset that is none": (sd.NotFoundError, lambda s: s["nope"]),
    "a name that none can have": (sd.InvalidInputError, lambda s: s["../etc"]),
    "a version that is none": (sd.NotFoundError, lambda s: s["drives"].at("0" * 16)),
    "an episode that is none": (sd.NotFoundError, lambda s: s["drives"].episode(12)),
    "an episode below zero": (sd.NotFoundError, lambda s: s["drives"].episode(-1)),
    "no labels": (
        sd.InvalidInputError,
        lambda s: s.create("plain", [drive(1, 5)], **NAMES).labeled(),
    ),
    "a run that is none": (sd.NotFoundError, lambda s: s["drives"].runs["nope"]),
    "a run name that none can have": (sd.InvalidInputError, lambda s: s["drives"].runs["a/b"]),
    "another version's run": (sd.ConflictError, lambda s: s["drives"].runs["old"]),
    "another version's values": (sd.ConflictError, lambda s: s["drives"].runs.values("old")),
    "another version's leverage": (sd.ConflictError, lambda s: s["drives"].leverage("old")),
    "another version's field": (sd.ConflictError, lambda s: s["drives"].field("old")),
    "a model that is none": (sd.NotFoundError, lambda s: s["drives"].model("nope")),
    "states of another width": (
        sd.InvalidInputError,
        lambda s: s["drives"].field("mdn").lcor(np.zeros((1, 4))),
    ),
    "states that are not finite": (
        sd.InvalidInputError,
        lambda s: s["drives"].field("mdn").cor(np.full((1, 3), np.nan)),
    ),
    "an alpha that is none": (
        sd.InvalidInputError,
        lambda s: s["drives"].field("mdn", alpha=-1.0),
    ),
    "another alpha that is none": (
        sd.InvalidInputError,
        lambda s: s["drives"].field("mdn").at(float("nan")),
    ),
    "options that conflict": (
        sd.InvalidInputError,
        lambda s: s["drives"].field("mdn").lcor(STATES, tolerance=0.1, contributors=2),
    ),
    "a tolerance that is none": (
        sd.InvalidInputError,
        lambda s: s["drives"].field("mdn").lcor(STATES, tolerance=0.0),
    ),
    "contributors below zero": (
        sd.InvalidInputError,
        lambda s: s["drives"].field("mdn").sums(STATES, contributors=-1),
    ),
    "pairs of another width": (
        sd.InvalidInputError,
        lambda s: s["drives"].model("mdn")(
            sd.Pairs(np.zeros((1, 2)), np.zeros((1, 2)), np.zeros(1, int), np.zeros(1, int))
        ),
    ),
    "a name that is taken": (
        sd.ConflictError,
        lambda s: s.create("drives", [drive(1, 5)], **NAMES),
    ),
    "no episodes": (sd.InvalidInputError, lambda s: s.create("empty", [], **NAMES)),
    "episodes of another width": (
        sd.InvalidInputError,
        lambda s: s["drives"].append([sd.Episode(np.zeros((2, 4)), np.zeros((2, 2)))]),
    ),
    "nothing to delete": (sd.NotFoundError, lambda s: s.delete("nope")),
    "fewer labels than two": (
        sd.InvalidInputError,
        lambda s: sd.score(s["drives"], sd.VAE(steps=5), labels=1),
    ),
    "more labels than there are": (
        sd.InvalidInputError,
        lambda s: sd.score(s["drives"], sd.VAE(steps=5), labels=999),
    ),
    "a default without unlabeled pairs": (
        sd.InvalidInputError,
        lambda s: sd.score(s.create("all", [drive(1, 9, labeled=True)], **NAMES)),
    ),
    "scoring without labels": (
        sd.InvalidInputError,
        lambda s: sd.score(s.create("bare", [drive(1, 5)], **NAMES), sd.VAE(steps=5)),
    ),
}


@pytest.mark.parametrize("what", MISTAKES)
def test_a_mistake_is_the_same_error(what: str, own: Any):
    kind, make = MISTAKES[what]
    with pytest.raises(sd.SsilDataError) as found:
        make(own)
    assert type(found.value) is kind
    assert str(found.value)
