"""The commands train and evaluate, fewer labels, and what a run shows, on Pendulum."""

from __future__ import annotations

import inspect
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ssil_data.cli import main
from ssil_data.commands import serving
from ssil_data.commands.output import Place
from ssil_data.demonstrations import Episode
from ssil_data.errors import ConflictError, InvalidInputError, NotFoundError
from ssil_data.scoring import score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_trainers.algorithms.config import PAPER
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.algorithms.policy import Policy
from ssil_trainers.commands import train as command
from ssil_trainers.commands.evaluate import drive as drive_by
from ssil_trainers.envs.registry import TASKS, find_spec, make_single, make_vectorized
from ssil_trainers.training.history import Evaluation, HistoryRow
from ssil_trainers.training.label_subset import expert_return, score_like, with_labels
from ssil_trainers.training.progress import tensorboard
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives

SHORT = ["--steps", "96", "--environments", "2", "--horizon", "16", "--hidden", "8"]
SHORT += ["--boundary", "2", "--evaluations", "1", "--cloning-steps", "5"]


@pytest.fixture
def pendulum(store: Store, monkeypatch: pytest.MonkeyPatch) -> Dataset:
    """Made-up swings: what is learned from them does not matter here."""
    rng = np.random.default_rng(0)
    episodes = [
        Episode(
            rng.normal(size=(40, 3)).astype(np.float32),
            rng.uniform(-2, 2, (40, 1)).astype(np.float32),
            labeled=number < 2,
        )
        for number in range(5)
    ]
    monkeypatch.setenv("SSIL_STORE", store.folder.uri)
    return store.create(
        "swings", episodes, state_names=["cos", "sin", "speed"], action_names=["torque"]
    )


def run(*words: object) -> int:
    with pytest.raises(SystemExit) as left:
        main([str(word) for word in words])
    return int(left.value.code or 0)


def test_train_then_evaluate_from_the_command_line(
    pendulum: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from ssil_data.estimators import VAE

    score(pendulum, VAE(steps=20), run="vae")
    train = ["train", "ssil", "--env", "Pendulum-v1", "--dataset", "swings", "--run", "vae"]
    assert run(*train, *SHORT, "-o", tmp_path / "out", "--json") == 0
    shown = capsys.readouterr()
    result = json.loads(shown.out)
    assert result["steps"] == 96
    assert "η" in shown.err and "steps/s" in shown.err
    names = {path.name.split(".")[0] for path in (tmp_path / "out").iterdir()}
    assert names == {"checkpoint", "curve", "events", "policy"}

    assert run(*train, *SHORT, "-o", tmp_path / "out") == 2
    assert "--resume goes on" in capsys.readouterr().err
    policy = tmp_path / "out" / "policy.safetensors"
    before = policy.read_bytes()
    assert run(*train, *SHORT, "-o", tmp_path / "out", "--resume") == 0
    assert policy.read_bytes() == before

    capsys.readouterr()
    assert run("evaluate", policy, "--episodes", 2, "--seed", 3, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["env"] == "Pendulum-v1" and told["score"] is None
    assert len(told["returns"]) == 2 and told["return"] == np.mean(told["returns"])
    env = make_single("Pendulum-v1")
    assert told["returns"][1] == drive_by(Policy.load(policy), env, seed=4)[0]


def test_the_preset_paper_is_trained_by_and_settings_beside_it_hold(
    pendulum: Dataset, tmp_path: Path
) -> None:
    train = ["train", "gail", "--env", "Pendulum-v1", "--dataset", "swings", *SHORT]
    for preset in ("default", "paper"):
        assert run(*train, "--preset", preset, "--kl", "0.02", "-o", tmp_path / preset) == 0
    default, paper = (
        Policy.load(tmp_path / preset / "policy.safetensors").described["settings"]
        for preset in ("default", "paper")
    )
    assert paper == {**default, **PAPER} != default
    assert paper["gae_lambda"] == 0 and paper["kl"] == 0.02


def test_resuming_without_a_checkpoint_says_that_it_begins(
    pendulum: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    train = ["train", "clone", "--env", "Pendulum-v1", "--dataset", "swings", "--resume"]
    told = []
    for _ in range(2):
        assert run(*train, *SHORT, "-o", tmp_path / "out") == 0
        told.append(capsys.readouterr().err)
    assert "No checkpoint in" in told[0] and "begins anew" in told[0]
    assert "No checkpoint" not in told[1]


def test_an_environment_without_finite_states_is_refused_in_one_line(
    pendulum: Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from gymnasium.envs.classic_control.pendulum import PendulumEnv

    monkeypatch.setattr(PendulumEnv, "_get_obs", lambda self: np.full(3, np.nan, np.float32))
    train = ["train", "gail", "--env", "Pendulum-v1", "--dataset", "swings"]
    with pytest.warns(UserWarning):
        assert run(*train, *SHORT, "-o", tmp_path / "out") == 2
    assert "environment: expected finite states, found nan" in capsys.readouterr().err


def test_the_help_describes_every_method() -> None:
    described = inspect.getdoc(command.train) or ""
    words = described.partition("method:")[2].partition("env:")[0]
    assert set(METHODS) <= set(re.findall(r"[\w-]+", words))


@pytest.mark.parametrize("missing", ["ssil_service", "fastapi", "uvicorn"])
def test_without_the_service_the_store_is_read(
    pendulum: Dataset, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    monkeypatch.setattr(serving, "import_module", lambda name: raise_missing(missing))
    with serving.open_store(Place(), None) as store:
        assert isinstance(store, Store)


@pytest.mark.parametrize("missing", ["ssil_service.server.embedded", "pyarrow"])
def test_a_service_that_is_broken_is_not_taken_for_none(
    pendulum: Dataset, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    monkeypatch.setattr(serving, "import_module", lambda name: raise_missing(missing))
    with pytest.raises(ModuleNotFoundError, match=missing), serving.open_store(Place(), None):
        pass


def raise_missing(name: str) -> None:
    raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def test_a_film_has_a_frame_for_every_step(
    pendulum: Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    imageio = pytest.importorskip("imageio.v2")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pytest.importorskip("pygame")
    train = ["train", "clone", "--env", "Pendulum-v1", "--dataset", "swings"]
    assert run(*train, *SHORT, "-o", tmp_path) == 0
    film = tmp_path / "films" / "one.mp4"
    assert run("evaluate", tmp_path / "policy.safetensors", "--episodes", 1, "--video", film) == 0
    with imageio.get_reader(film) as frames:
        assert frames.count_frames() == 200
        assert np.ptp(frames.get_data(10)) > 0
    assert "film: 200 of 200" in capsys.readouterr().err
    assert run("evaluate", tmp_path / "policy.safetensors", "--video", "one.gif") == 2
    told = capsys.readouterr().err
    assert "ending in .mp4, found one.gif" in told and "drive" not in told


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["ssil", "--dataset", "swings"], "ssil: expected --run"),
        (["gail", "--dataset", "swings", "--labels", "100"], "labels: expected 2 to 80"),
        (["gail", "--dataset", "none"], "expected one of [swings]"),
        (["ssil", "--dataset", "swings", "--run", "none"], "found 'none'"),
        (["gail", "--dataset", "swings", "--kl", "0"], "kl: expected a number above 0"),
    ],
)
def test_what_cannot_be_trained_is_refused_before_anything_is_written(
    pendulum: Dataset,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    message: str,
) -> None:
    out = tmp_path / "out"
    assert run("train", *words, "--env", "Pendulum-v1", *SHORT[:2], "-o", out) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_a_policy_for_other_states_is_refused(
    pendulum: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    train = ["train", "clone", "--env", "Pendulum-v1", "--dataset", "swings"]
    assert run(*train, *SHORT, "-o", tmp_path) == 0
    policy = tmp_path / "policy.safetensors"
    assert run("evaluate", policy, "--env", "MountainCarContinuous-v0") == 2
    assert "shapes ((2,), (1,)) of the environment, found ((3,), (1,))" in capsys.readouterr().err


def test_demonstrations_of_another_width_are_refused(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = ["--store", dataset.folder.uri.rsplit("/", 1)[0]]
    words = ["train", "gail", "--env", "Pendulum-v1", "--dataset", "drives", *place]
    assert run(*words, *SHORT, "-o", tmp_path / "out") == 2
    told = capsys.readouterr().err
    assert "widths (3, 1) of the environment, found (3, 2)" in told
    assert not (tmp_path / "out").exists()


def test_unknown_environments_are_refused_by_name() -> None:
    with pytest.raises(NotFoundError, match=r"racetrack.*found 'racetrakc'"):
        find_spec("racetrakc")


def test_a_task_takes_the_environments_settings() -> None:
    assert find_spec("racetrack?policy_hz=5&track=oval").kwargs == {"policy_hz": 5, "track": "oval"}
    assert find_spec("racetrack").kwargs == {}
    assert find_spec("Pendulum-v1?g=9.81").kwargs == {"g": 9.81}
    for task, message in (("racetrack?fast", "key=value"), ("racetrack?wings=2", "wings")):
        with pytest.raises(InvalidInputError, match=message):
            make_vectorized(task, 1)
    with pytest.raises(InvalidInputError, match="wings"):
        make_single("Pendulum-v1?wings=2")


@pytest.mark.parametrize("task", TASKS)
def test_the_projects_tasks_can_be_driven_alone_and_side_by_side(task: str) -> None:
    envs, env = make_vectorized(task, 2), make_single(task)
    assert envs.single_observation_space == env.observation_space
    assert envs.single_action_space == env.action_space
    assert envs.metadata["autoreset_mode"].value == "SameStep"


def test_fewer_labels_are_the_first_and_the_unlabeled_stay(store: Store, dataset: Dataset) -> None:
    fewer = with_labels(store, "drives", 80)
    before, after = dataset.pairs(), fewer.pairs()
    labeled = fewer.per_pair("labeled").astype(bool)
    assert labeled.sum() == 80
    np.testing.assert_array_equal(after.states[labeled], before.states[:80])
    np.testing.assert_array_equal(after.states[~labeled], before.states[120:])
    np.testing.assert_array_equal(after.actions[~labeled], before.actions[120:])
    assert fewer.episodes["length"].to_pylist()[:3] == [60, 20, 50]
    assert fewer.episodes["score"].to_pylist()[2:] == dataset.episodes["score"].to_pylist()[2:]
    assert with_labels(store, "drives", 80).version == fewer.version
    assert with_labels(store, "drives", 60).episodes["length"].to_pylist()[:2] == [60, 50]
    assert with_labels(store, "drives", 120).name == "drives"


def test_fewer_labels_of_another_version_are_made_anew(store: Store, dataset: Dataset) -> None:
    before = with_labels(store, "drives", 80)
    appended = dataset.append([drive(9, 30)])
    after = with_labels(store, "drives", 80)
    assert after.name != before.name
    assert len(after.pairs().states) == len(before.pairs().states) + 30
    assert before.name.endswith(dataset.version) and after.name.endswith(appended.version)


def test_a_run_on_fewer_labels_that_was_made_otherwise_is_refused(
    store: Store, dataset: Dataset
) -> None:
    from ssil_data.estimators import VAE

    fewer = with_labels(store, "drives", 80)
    score(dataset, VAE(steps=20), seed=3, run="vae")
    score(fewer, VAE(steps=20), seed=4, run="vae")
    with pytest.raises(ConflictError, match=r"run 'vae' of drives-80.*expected seed 3.*found 4"):
        score_like(fewer, dataset, "vae", lambda what, done, of: None)


def test_a_run_on_fewer_labels_is_made_as_the_one_on_all(store: Store, dataset: Dataset) -> None:
    from ssil_data.estimators import VAE
    from ssil_data.scales import MinMax

    score(dataset, VAE(steps=20), scale=MinMax(), labeled_is_one=True, seed=3, run="vae")
    fewer = with_labels(store, "drives", 80)
    for _ in range(2):
        score_like(fewer, dataset, "vae", lambda what, done, of: None)
    one, other = dataset.runs["vae"], fewer.runs["vae"]
    assert (one.estimator, one.scale, one.seed) == (other.estimator, other.scale, other.seed)
    assert other.labeled_is_one and other.labeled == 80


def test_the_experts_return_is_what_a_score_of_one_is(store: Store) -> None:
    def episode(score: float | None, ending: str, total: float) -> Episode:
        plain = drive(1, 10, score=score, ending=ending)
        return replace(plain, rewards=np.full(10, total / 10, np.float32))

    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    whole = [episode(0.5, "terminated", 10.0), episode(1.1, "truncated", 22.0)]
    made = store.create("whole", [*whole, episode(0.9, "cut", 3.0)], **names)
    assert expert_return(made) == pytest.approx(20)
    assert expert_return(store.create("cut", [episode(0.9, "cut", 3.0)], **names)) is None
    assert expert_return(store.create("bare", drives(), **names)) is None


def test_every_figure_of_a_run_is_a_tensorboard_event(tmp_path: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    seen: list[HistoryRow] = []
    with tensorboard(tmp_path, seen.append) as both:
        both(HistoryRow(0, None, Evaluation(mean=-3.0, least=-4.0, length=20.0, score=0.5)))
    assert len(seen) == 1
    read = EventAccumulator(str(tmp_path))
    read.Reload()
    assert set(read.Tags()["scalars"]) == {"return_mean", "return_least", "return_length", "score"}
    assert read.Scalars("score")[0].value == 0.5
