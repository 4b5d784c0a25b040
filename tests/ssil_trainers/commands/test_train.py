"""The command train, on Pendulum."""

from __future__ import annotations

import csv
import inspect
import json
import re
from pathlib import Path

import numpy as np
import pytest
from gymnasium.envs.classic_control.pendulum import PendulumEnv

from ssil_data.demonstrations import Episode
from ssil_data.estimators import VAE
from ssil_data.scales import Posterior, Quantile
from ssil_data.scoring import Recipe, score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_trainers.algorithms import tensor_file
from ssil_trainers.algorithms.config import PAPER
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.algorithms.policy import Policy
from ssil_trainers.commands import train as command
from ssil_trainers.envs.registry import make_single
from ssil_trainers.training.checkpoint import CHECKPOINT, KIND, STORED_NAMES
from ssil_trainers.training.evaluation import drive_episode
from support.command_line import SHORT_TRAINING, run


def test_train_then_evaluate_from_the_command_line(
    pendulum: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    score(pendulum, VAE(steps=20), run="vae")
    train = ["train", "ssil", "--env", "Pendulum-v1", "--dataset", "swings", "--run", "vae"]
    assert run(*train, *SHORT_TRAINING, "-o", tmp_path / "out", "--json") == 0
    shown = capsys.readouterr()
    result = json.loads(shown.out)
    assert result["steps"] == 96
    assert "η" in shown.err and "steps/s" in shown.err
    names = {path.name.split(".")[0] for path in (tmp_path / "out").iterdir()}
    assert names == {"checkpoint", "curve", "events", "policy"}

    assert run(*train, *SHORT_TRAINING, "-o", tmp_path / "out") == 2
    assert "--resume goes on" in capsys.readouterr().err
    policy = tmp_path / "out" / "policy.safetensors"
    before = policy.read_bytes()
    assert run(*train, *SHORT_TRAINING, "-o", tmp_path / "out", "--resume") == 0
    assert policy.read_bytes() == before

    capsys.readouterr()
    assert run("evaluate", policy, "--episodes", 2, "--seed", 3, "--json") == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["env"] == "Pendulum-v1" and shown["score"] is None
    assert len(shown["returns"]) == 2 and shown["return"] == np.mean(shown["returns"])
    env = make_single("Pendulum-v1")
    assert shown["returns"][1] == drive_episode(Policy.load(policy), env, seed=4)[0]


def test_the_preset_paper_changes_its_settings_and_no_others(
    pendulum: Dataset, tmp_path: Path
) -> None:
    train = ["train", "gail", "--env", "Pendulum-v1", "--dataset", "swings", *SHORT_TRAINING]
    for preset in ("default", "paper"):
        assert run(*train, "--preset", preset, "--kl", "0.02", "-o", tmp_path / preset) == 0
    default, paper = (
        Policy.load(tmp_path / preset / "policy.safetensors").metadata["settings"]
        for preset in ("default", "paper")
    )
    stored = {STORED_NAMES.get(name, name): value for name, value in PAPER.items()}
    assert paper == {**default, **stored} != default
    assert paper["gae_lambda"] == 0 and paper["kl"] == 0.02


def test_the_sharpness_of_cor_is_a_flag_and_part_of_the_policys_record(
    pendulum: Dataset, tmp_path: Path
) -> None:
    train = ["train", "mixgail", "--env", "Pendulum-v1", "--dataset", "swings", *SHORT_TRAINING]
    found = []
    for alpha in ("auto", "7.5"):
        assert run(*train, "--cor-alpha", alpha, "-o", tmp_path / alpha) == 0
        metadata = Policy.load(tmp_path / alpha / "policy.safetensors").metadata
        found.append(metadata["settings"]["cor_alpha"])
    assert found[0] > 0 and found[1] == 7.5


def test_weight_decay_of_cloning_is_a_flag_and_part_of_the_policys_record(
    pendulum: Dataset, tmp_path: Path
) -> None:
    train = ["train", "clone", "--env", "Pendulum-v1", "--dataset", "swings", *SHORT_TRAINING]
    files = []
    for name, more in (
        ("usual", []),
        ("off", ["--cloning-weight-decay", "0"]),
        ("on", ["--cloning-weight-decay", "1.5"]),
    ):
        assert run(*train, *more, "-o", tmp_path / name) == 0
        files.append((tmp_path / name / "policy.safetensors").read_bytes())
    assert files[0] == files[1] != files[2]
    stored = [
        Policy.load(tmp_path / name / "policy.safetensors").metadata["settings"]
        for name in ("usual", "on")
    ]
    assert [each["cloning_weight_decay"] for each in stored] == [0.0, 1.5]


def test_the_weighting_and_the_pair_reward_are_flags_and_part_of_the_policys_record(
    pendulum: Dataset, tmp_path: Path
) -> None:
    score(pendulum, VAE(steps=20), run="vae")
    train = ["train", "ssil-leverage", "--env", "Pendulum-v1", "--dataset", "swings"]
    train += ["--run", "vae", *SHORT_TRAINING]
    flags = ["--expert-weighting", "ratio", "--odds-limit", "9", "--pair-reward", "0.5"]
    found = {}
    for name, more in (("usual", []), ("flags", flags)):
        assert run(*train, *more, "-o", tmp_path / name) == 0
        found[name] = Policy.load(tmp_path / name / "policy.safetensors").metadata["settings"]
    names = ("expert_weighting", "odds_limit", "pair_reward")
    assert [found["usual"][name] for name in names] == ["sure", 20.0, 0.0]
    assert [found["flags"][name] for name in names] == ["ratio", 9.0, 0.5]
    with (tmp_path / "flags" / "curve.csv").open() as lines:
        assert all(float(row["log_odds"]) != 0 for row in list(csv.DictReader(lines))[1:])


@pytest.mark.parametrize("method", ["ssil", "ssil-leverage", "mixgail"])
def test_a_pair_reward_and_a_sharpness_of_cor_train_finitely_with_a_third_critic(
    pendulum: Dataset, tmp_path: Path, method: str
) -> None:
    """The state reward is centered, so that η follows a third critic; each flag has its method."""
    score(pendulum, VAE(steps=20), run="vae")
    train = ["train", method, "--env", "Pendulum-v1", "--dataset", "swings", "--run", "vae"]
    train += [*SHORT_TRAINING, "--eta-decay", "0.5"]
    own = ["--cor-alpha", "7.5"] if method == "mixgail" else ["--pair-reward", "0.5"]
    policies = []
    for name, flags in (("own", own), ("none", [])):
        assert run(*train, *flags, "-o", tmp_path / name) == 0
        policies.append(Policy.load(tmp_path / name / "policy.safetensors"))
        with (tmp_path / name / "curve.csv").open() as lines:
            rows = list(csv.DictReader(lines))[1:]
        figures = [
            [float(row[key]) for key in ("eta", "kl", "shaping", "log_odds")] for row in rows
        ]
        assert np.isfinite(figures).all() and len(figures) == 3
    weights = [[part for layer in policy.layers for part in layer] for policy in policies]
    assert all(np.isfinite(part).all() for part in weights[0])
    assert any((a != b).any() for a, b in zip(weights[0], weights[1], strict=True))


def test_a_control_of_the_weights_is_trained_from_the_command_line(
    pendulum: Dataset, tmp_path: Path
) -> None:
    score(pendulum, VAE(steps=20), run="vae")
    layers = []
    for method in ("clone-leverage", "clone-shuffled"):
        words = ["train", method, "--env", "Pendulum-v1", "--dataset", "swings", "--run", "vae"]
        assert run(*words, *SHORT_TRAINING, "-o", tmp_path / method) == 0
        layers.append(Policy.load(tmp_path / method / "policy.safetensors").layers[0][0])
    assert (layers[0] != layers[1]).any()


def test_training_by_a_weak_run_says_why_it_is_weak_in_one_line(
    pendulum: Dataset, store: Store, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pairs = pendulum.episode(0)
    few = [Episode(pairs.states, pairs.actions, labeled=number < 1) for number in range(3)]
    names = {"state_names": pendulum.state_names, "action_names": pendulum.action_names}
    weak = score(store.create("few", few, **names), VAE(steps=20), run="vae").weak
    assert any("one episode" in reason for reason in weak)
    for method in ("ssil", "gail-leverage", "clone-leverage", "shuffled", "mixgail", "clone"):
        words = ["train", method, "--env", "Pendulum-v1", "--dataset", "few", "--run", "vae"]
        capsys.readouterr()
        assert run(*words, *SHORT_TRAINING, "--json", "-o", tmp_path / method) == 0
        shown = capsys.readouterr()
        assert "steps" in json.loads(shown.out)
        lines = [line for line in shown.err.splitlines() if "Weak" in line]
        uses_leverage = method not in ("mixgail", "clone")
        assert lines == ([f"Weak: vae: {'; '.join(weak)}"] if uses_leverage else []), method


def test_training_where_no_pair_is_sure_says_that_labeled_pairs_alone_are_imitated(
    pendulum: Dataset, store: Store, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pairs = pendulum.episode(0)
    alike = Episode(np.tile(pairs.states[:1], (50, 1)), np.tile(pairs.actions[:1], (50, 1)))
    names = {"state_names": pendulum.state_names, "action_names": pendulum.action_names}
    labeled = Episode(pairs.states, pairs.actions, labeled=True)
    doubtful = store.create("doubtful", [labeled, alike], **names)
    score(doubtful, Recipe(VAE(steps=20), Posterior()), run="vae")
    words = ["--env", "Pendulum-v1", "--dataset", "doubtful", "--run", "vae"]
    for method, more, is_told in (
        ("clone-leverage", [], True),
        ("clone-leverage", ["--expert-weighting", "posterior"], False),
        ("ssil", [], False),
    ):
        capsys.readouterr()
        output = tmp_path / f"{method}-{len(more)}"
        assert run("train", method, *words, *more, *SHORT_TRAINING, "-o", output) == 0
        told = "imitates labeled pairs alone" in " ".join(capsys.readouterr().err.split())
        assert told == is_told, (method, more)


def test_training_by_a_run_on_fewer_labels_says_that_it_imitates_all(
    pendulum: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    labeled = int(pendulum.per_pair("labeled").sum())
    score(pendulum, VAE(steps=20), labels=30, run="thirty")
    words = ["--env", "Pendulum-v1", "--dataset", "swings", "--run", "thirty", *SHORT_TRAINING]
    for method, more, is_told in (
        ("clone-leverage", [], True),
        ("clone-leverage", ["--labels", "30"], False),
        ("ssil", [], False),
    ):
        capsys.readouterr()
        assert run("train", method, *words, *more, "-o", tmp_path / f"{method}-{len(more)}") == 0
        told = " ".join(capsys.readouterr().err.split())
        line = f"thirty rests on 30 labeled pairs, and clone-leverage imitates all {labeled:,}"
        assert (line in told) == is_told, (method, more)


def test_training_by_few_sure_pairs_says_how_much_of_a_batch_they_are(
    pendulum: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    score(pendulum, VAE(steps=20), run="vae")
    labeled = pendulum.per_pair("labeled").astype(bool)
    sure = int((pendulum.leverage("vae")[~labeled] >= 0.95).sum())
    assert 0 < sure < labeled.sum()
    words = ["--env", "Pendulum-v1", "--dataset", "swings", "--run", "vae", *SHORT_TRAINING]
    part = f"so {100 * sure / (sure + labeled.sum()):.2g} % of what"
    for method, is_told in (("clone-leverage", True), ("gail-shuffled", True), ("ssil", False)):
        capsys.readouterr()
        assert run("train", method, *words, "-o", tmp_path / method) == 0
        told = " ".join(capsys.readouterr().err.split())
        assert (f"{part} {method} imitates is unlabeled, not half" in told) == is_told
        assert ("none of them counts more than a labeled one" in told) == is_told


@pytest.mark.parametrize(("share", "is_told"), [(0.494, True), (0.497, False), (0.5, False)])
def test_what_is_rounded_to_a_half_is_not_called_less(
    share: float,
    is_told: bool,
    pendulum: Dataset,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    score(pendulum, VAE(steps=20), run="vae")
    monkeypatch.setattr(command, "share_of_unlabeled", lambda labeled, weights: share)
    words = ["--env", "Pendulum-v1", "--dataset", "swings", "--run", "vae", *SHORT_TRAINING]
    assert run("train", "clone-leverage", *words, "-o", tmp_path / "out") == 0
    assert ("not half" in " ".join(capsys.readouterr().err.split())) == is_told


def test_training_by_sure_pairs_of_leverage_that_is_no_chance_says_so(
    pendulum: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, scale in (("rank", Quantile()), ("chance", Posterior())):
        score(pendulum, Recipe(VAE(steps=20), scale), run=name)
    for method, name, more, is_told in (
        ("clone-leverage", "rank", [], True),
        ("clone-leverage", "rank", ["--expert-weighting", "ratio"], False),
        ("clone-leverage", "chance", [], False),
        ("ssil", "rank", [], False),
    ):
        words = ["train", method, "--env", "Pendulum-v1", "--dataset", "swings", "--run", name]
        output = tmp_path / f"{method}-{name}-{len(more)}"
        capsys.readouterr()
        assert run(*words, *more, *SHORT_TRAINING, "-o", output) == 0
        lines = [line for line in capsys.readouterr().err.splitlines() if "by the scale" in line]
        assert len(lines) == is_told, (method, name, more)
        assert not lines or lines[0].startswith("Leverage of rank is by the scale quantile, and a")


def test_training_that_uses_no_run_says_so_where_one_is_named(
    pendulum: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    score(pendulum, VAE(steps=20), run="vae")
    words = ["--env", "Pendulum-v1", "--dataset", "swings", "--run", "vae", *SHORT_TRAINING]
    for method, uses_run in (("gail", False), ("clone", False), ("mixgail", True), ("ssil", True)):
        capsys.readouterr()
        assert run("train", method, *words, "-o", tmp_path / method) == 0
        told = f"{method} uses no scoring run, so --run vae changes nothing."
        assert (told in capsys.readouterr().err) != uses_run


def test_a_run_begun_with_an_option_that_it_does_not_use_goes_on_with_it(
    pendulum: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Version 0.1 took every option and kept it."""
    out = tmp_path / "out"
    train = ["train", "gail", "--env", "Pendulum-v1", "--dataset", "swings", *SHORT_TRAINING]
    assert run(*train, "-o", out) == 0
    arrays, metadata = tensor_file.read(out / CHECKPOINT, KIND)
    metadata["identity"]["settings"] |= {"eta": 3.0, "centred": False}
    tensor_file.write(out / CHECKPOINT, arrays, metadata)
    flags = ["--eta", "3", "--no-centered", "-o", out]
    assert run(*train, *flags, "--resume") == 0
    for wrong, message in (
        ([*flags], "--eta: used by mixgail"),
        (["--eta", "2", "--no-centered", "-o", out, "--resume"], "--eta: used by mixgail"),
        (["-o", out, "--resume"], "eta 3.0 as before, found 1.0"),
    ):
        capsys.readouterr()
        before = {path: path.read_bytes() for path in out.iterdir()}
        assert run(*train, *wrong) == 2
        assert message in " ".join(capsys.readouterr().err.split())
        assert {path: path.read_bytes() for path in out.iterdir()} == before


@pytest.mark.parametrize(
    ("method", "preset", "flags"),
    [
        ("clone", "default", ["--no-pretrained"]),
        ("constant", "default", ["--discriminator-steps", "5", "--spectral-norm"]),
        ("gail", "paper", ["--gae-lambda", "0.5", "--spectral-norm"]),
        ("clone", "paper", ["--gae-lambda", "0.5", "--no-pretrained"]),
    ],
)
def test_a_run_begun_with_an_option_whose_value_was_replaced_goes_on_with_it(
    method: str,
    preset: str,
    flags: list[str],
    pendulum: Dataset,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Version 0.1 took every option and kept the method's or the preset's value."""
    words = ["--env", "Pendulum-v1", "--dataset", "swings", "--preset", preset]
    train = ["train", method, *words, *SHORT_TRAINING, "-o", tmp_path / "out"]
    assert run(*train) == 0
    policy = (tmp_path / "out" / "policy.safetensors").read_bytes()
    assert run(*train, *flags) == 2
    capsys.readouterr()
    assert run(*train, *flags, "--resume") == 0, capsys.readouterr().err
    assert (tmp_path / "out" / "policy.safetensors").read_bytes() == policy
    assert run(*train, *flags, "--kl", "0.3", "--resume") == 2


def test_resuming_without_a_checkpoint_starts_and_says_so(
    pendulum: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    train = ["train", "clone", "--env", "Pendulum-v1", "--dataset", "swings", "--resume"]
    shown = []
    for _ in range(2):
        assert run(*train, *SHORT_TRAINING, "-o", tmp_path / "out") == 0
        shown.append(capsys.readouterr().err)
    assert "No checkpoint in" in shown[0] and "starts from the beginning" in shown[0]
    assert "No checkpoint" not in shown[1]


def test_an_environment_without_finite_states_is_refused_in_one_line(
    pendulum: Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(PendulumEnv, "_get_obs", lambda self: np.full(3, np.nan, np.float32))
    train = ["train", "gail", "--env", "Pendulum-v1", "--dataset", "swings"]
    with pytest.warns(UserWarning):
        assert run(*train, *SHORT_TRAINING, "-o", tmp_path / "out") == 2
    assert "environment: expected finite states, found nan" in capsys.readouterr().err


def test_the_help_describes_every_method() -> None:
    described = inspect.getdoc(command.train) or ""
    words = described.partition("method:")[2].partition("env:")[0]
    assert set(METHODS) <= set(re.findall(r"[\w-]+", words))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["ssil", "--dataset", "swings"],
            "needs the leverage of a scoring run; name it by --run",
        ),
        (["gail", "--dataset", "swings", "--labels", "100"], "labels: expected 2 to 80"),
        (["gail", "--dataset", "none"], "expected one of [swings]"),
        (["ssil", "--dataset", "swings", "--run", "none"], "found 'none'"),
        (["gail", "--dataset", "swings", "--kl", "0"], "kl: expected a number above 0"),
        (["clone-shuffled", "--dataset", "swings"], "needs the leverage of a scoring run"),
        (["gail", "--dataset", "swings", "--odds-limit", "1"], "odds_limit: expected a number"),
        (["gail", "--dataset", "swings", "--expert-weighting", "all"], "sure"),
        (["mixgail", "--dataset", "swings", "--cor-alpha", "0"], "cor_alpha: expected auto or a"),
        (["mixgail", "--dataset", "swings", "--cor-alpha", "sharp"], "--cor-alpha"),
        (
            ["clone", "--dataset", "swings", "--cloning-weight-decay", "-1"],
            "cloning_weight_decay: expected a number of at least 0, found -1.0",
        ),
        (
            ["clone", "--dataset", "swings", "--cloning-weight-decay", "nan"],
            "cloning_weight_decay: expected a number of at least 0, found nan",
        ),
        (
            ["clone", "--dataset", "swings", "--cloning-weight-decay", "inf"],
            "cloning_weight_decay: expected a number of at least 0, found inf",
        ),
        (
            ["clone", "--dataset", "swings", "--cloning-weight-decay", "1001"],
            "cloning_weight_decay: expected at most 1 / cloning_rate, 1000, found 1001.0",
        ),
        (["clone", "--dataset", "swings", "--cloning-weight-decay", "much"], "--cloning-weight"),
        (
            ["ssil", "--dataset", "swings", "--run", "vae", "--cor-alpha", "7.5"],
            "--cor-alpha: used by mixgail, not by ssil",
        ),
        (
            ["mixgail", "--dataset", "swings", "--pair-reward", "0.5"],
            "--pair-reward: used by ssil, ssil-leverage, not by mixgail",
        ),
        (
            ["gail", "--dataset", "swings", "--no-centered", "--eta", "2"],
            "--eta: used by mixgail, ssil, ssil-leverage, shuffled, not by gail; --no-centered:",
        ),
        (
            ["clone", "--dataset", "swings", "--kl", "0.02"],
            "--kl: used by gail, gail-mixed, mixgail, ssil, gail-leverage,",
        ),
        (
            ["clone-leverage", "--dataset", "swings", "--run", "vae", "--odds-limit", "5"],
            "--odds-limit: used by clone-leverage only with --expert-weighting ratio",
        ),
        (
            ["clone", "--dataset", "swings", "--no-pretrained"],
            "--no-pretrained: used by gail, gail-mixed,",
        ),
        (
            ["constant", "--dataset", "swings", "--discriminator-steps", "10"],
            "--discriminator-steps: used by gail, gail-mixed,",
        ),
        (
            [
                *["ssil", "--dataset", "swings", "--run", "vae", "--preset", "paper"],
                *["--pair-reward", "0.5", "--gae-lambda", "0.97", "--gradient-penalty", "0"],
            ],
            "--preset paper: has --gae-lambda 0.0, --pair-reward 0.0; leave out --gae-lambda 0.97 "
            "and --pair-reward 0.5, or the preset",
        ),
        (
            ["ssil", "--dataset", "swings", "--run", "vae", "--preset", "paper", "--centered"],
            "--preset paper: has --no-centered; leave out --centered, or the preset",
        ),
        (
            ["gail", "--dataset", "swings", "--cloning-weight-decay", "1"],
            "--cloning-weight-decay: used by gail only with --pretrained",
        ),
    ],
)
def test_a_wrong_training_command_is_refused_before_anything_is_written(
    pendulum: Dataset,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    message: str,
) -> None:
    out = tmp_path / "out"
    assert run("train", *words, "--env", "Pendulum-v1", *SHORT_TRAINING[:2], "-o", out) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_demonstrations_of_another_width_are_refused(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = ["--store", dataset.folder.uri.rsplit("/", 1)[0]]
    words = ["train", "gail", "--env", "Pendulum-v1", "--dataset", "drives", *place]
    assert run(*words, *SHORT_TRAINING, "-o", tmp_path / "out") == 2
    shown = capsys.readouterr().err
    assert "widths (3, 1) of the environment, found (3, 2)" in shown
    assert not (tmp_path / "out").exists()
