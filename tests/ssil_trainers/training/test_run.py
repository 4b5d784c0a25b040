"""Runs that are stopped, resumed and repeated end with the same bytes."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from ssil_data.errors import ConflictError, InvalidInputError
from ssil_trainers.algorithms import tensor_file
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.cor_sharpness import auto_cor_alpha
from ssil_trainers.algorithms.policy import Policy
from ssil_trainers.training.checkpoint import CHECKPOINT, KIND
from ssil_trainers.training.data import TrainingData
from ssil_trainers.training.history import HistoryRow
from ssil_trainers.training.run import (
    CURVE,
    POLICY,
    Callback,
    TrainResult,
    train,
)
from support.toy_environment import STEPS, LineEnv, demonstrations

SETTINGS = TrainSettings(
    steps=7 * 4 * STEPS,
    environments=4,
    horizon=STEPS // 2 * 2,
    hidden=8,
    discriminator_batch=16,
    boundary=3,
    evaluate_every=2,
    evaluations=2,
    pretrained=True,
    cloning_steps=5,
)


def train_toy(
    folder: Path | None,
    method: str = "ssil",
    *,
    run: str = "toy",
    resume: bool = False,
    callback: Callback = lambda row: None,
    **settings: object,
) -> TrainResult:
    """Train in the toy environment, whose expert's return is taken for -2."""
    return train(
        method,
        TrainingData(demonstrations(), -2.0, identity={"run": run}),
        LineEnv,
        settings=replace(SETTINGS, **settings),
        folder=folder,
        resume=resume,
        callback=callback,
    )


class Stop(KeyboardInterrupt):
    """Ctrl-C."""


def stop_after(iterations: int) -> Callback:
    def stop(row: HistoryRow) -> None:
        if row.iteration is not None and row.iteration.number == iterations:
            raise Stop

    return stop


def test_same_seed_same_bytes_and_another_seed_others(tmp_path: Path) -> None:
    files = []
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        train_toy(tmp_path / name, seed=seed)
        files.append([(tmp_path / name / f).read_bytes() for f in (POLICY, CHECKPOINT, CURVE)])
    assert files[0] == files[1]
    assert all(one != other for one, other in zip(files[0], files[2], strict=True))


@pytest.mark.parametrize("stops", [[1], [3], [4], [2, 5], [7]])
@pytest.mark.parametrize("option", [{}, {"spectral_norm": True}])
def test_interrupted_and_resumed_is_uninterrupted(
    tmp_path: Path, stops: list[int], option: dict[str, bool]
) -> None:
    train_toy(tmp_path / "whole", **option)
    for stop in stops:
        with pytest.raises(Stop):
            train_toy(tmp_path / "cut", **option, resume=True, callback=stop_after(stop))
    result = train_toy(tmp_path / "cut", **option, resume=True)
    for name in (POLICY, CHECKPOINT, CURVE):
        assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    assert [row.steps for row in result.curve] == [80 * k for k in range(8)]


def write_as_version_0_1(folder: Path, *, lacks: set[str]) -> None:
    """Take settings and figures out of a checkpoint that its first version did not have."""
    arrays, metadata = tensor_file.read(folder / CHECKPOINT, KIND)
    assert lacks <= set(metadata["identity"]["settings"])
    for name in lacks:
        del metadata["identity"]["settings"][name]
    for row in metadata["curve"]:
        if row["iteration"] is not None:
            del row["iteration"]["log_odds"]
    tensor_file.write(folder / CHECKPOINT, arrays, metadata)


NEW_SETTINGS = {
    "pair_reward",
    "expert_weighting",
    "odds_limit",
    "cor_alpha",
    "cloning_weight_decay",
}


def test_a_checkpoint_without_newer_settings_goes_on_with_their_defaults(tmp_path: Path) -> None:
    train_toy(tmp_path / "whole", centered=False)
    with pytest.raises(Stop):
        train_toy(tmp_path / "cut", centered=False, callback=stop_after(5))
    write_as_version_0_1(tmp_path / "cut", lacks=NEW_SETTINGS)
    with pytest.raises(ConflictError, match=r"odds_limit 20.0 as before, found 9.0"):
        train_toy(tmp_path / "cut", centered=False, resume=True, odds_limit=9.0)
    result = train_toy(tmp_path / "cut", centered=False, resume=True)
    assert [row.steps for row in result.curve] == [80 * k for k in range(8)]
    assert (tmp_path / "cut" / POLICY).read_bytes() == (tmp_path / "whole" / POLICY).read_bytes()


def test_a_checkpoint_whose_eta_followed_another_rule_is_refused(tmp_path: Path) -> None:
    train_toy(tmp_path / "ssil")
    train_toy(tmp_path / "gail", "gail")
    for method in ("ssil", "gail"):
        write_as_version_0_1(tmp_path / method, lacks=NEW_SETTINGS)
    with pytest.raises(ConflictError, match=r"ssil of version 0\.1 judged η by the centered"):
        train_toy(tmp_path / "ssil", resume=True)
    assert train_toy(tmp_path / "gail", "gail", resume=True).curve  # no state reward, no other rule


def test_the_sharpness_of_cor_is_stored_as_it_was_fitted(tmp_path: Path) -> None:
    of = demonstrations()
    fitted = auto_cor_alpha(of.standardizer(of.states), of.labeled)
    for name, settings in (("auto", {}), ("given", {"cor_alpha": fitted})):
        train_toy(tmp_path / name, "mixgail", **settings)
        assert Policy.load(tmp_path / name / POLICY).metadata["settings"]["cor_alpha"] == fitted
    files = [(tmp_path / name / POLICY).read_bytes() for name in ("auto", "given")]
    assert files[0] == files[1]
    train_toy(tmp_path / "ssil")
    assert Policy.load(tmp_path / "ssil" / POLICY).metadata["settings"]["cor_alpha"] == "auto"


@pytest.mark.parametrize("method", ["gail-leverage", "clone-leverage"])
def test_a_checkpoint_whose_batches_were_drawn_in_another_way_is_refused(
    tmp_path: Path, method: str
) -> None:
    train_toy(tmp_path, method)
    assert train_toy(tmp_path, method, resume=True).curve
    write_as_version_0_1(tmp_path, lacks=NEW_SETTINGS)
    with pytest.raises(ConflictError, match=f"{method} of version 0.1 drew whole batches"):
        train_toy(tmp_path, method, resume=True)


@pytest.mark.parametrize(
    ("method", "settings"),
    [
        ("gail-leverage", {}),
        ("gail-leverage", {"expert_weighting": "ratio"}),
        ("clone-leverage", {"expert_weighting": "ratio", "odds_limit": 3.0}),
        ("gail-shuffled", {}),
        ("clone-shuffled", {}),
    ],
)
def test_imitation_by_weight_has_the_same_bytes_for_the_same_seed(
    tmp_path: Path, method: str, settings: dict[str, object]
) -> None:
    files = []
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        train_toy(tmp_path / name, method, seed=seed, **settings)
        files.append((tmp_path / name / POLICY).read_bytes())
    assert files[0] == files[1] != files[2]
    stored = Policy.load(tmp_path / "a" / POLICY).metadata["settings"]
    assert stored["expert_weighting"] == settings.get("expert_weighting", "sure")
    assert stored["odds_limit"] == settings.get("odds_limit", 20.0)


def test_files_name_the_settings_as_version_0_1_did(tmp_path: Path) -> None:
    train_toy(tmp_path / "out")
    for name, kind in ((CHECKPOINT, KIND), (POLICY, "ssil policy")):
        _, metadata = tensor_file.read(tmp_path / "out" / name, kind)
        settings = metadata.get("identity", metadata)["settings"]
        assert settings["centred"] is True
        assert "centered" not in settings
    with pytest.raises(ConflictError, match="centred True as before, found False"):
        train_toy(tmp_path / "out", resume=True, centered=False)


def test_a_finished_run_extended_equals_a_longer_run(tmp_path: Path) -> None:
    longer = SETTINGS.steps + 4 * 80
    train_toy(tmp_path / "whole", steps=longer)
    train_toy(tmp_path / "cut")
    train_toy(tmp_path / "cut", steps=longer, resume=True)
    whole, cut = (Policy.load(tmp_path / name / POLICY) for name in ("whole", "cut"))
    for one, other in zip(whole.layers, cut.layers, strict=True):
        np.testing.assert_array_equal(one[0], other[0])


def test_random_numbers_drawn_elsewhere_change_no_byte(tmp_path: Path) -> None:
    one = train_toy(None).policy
    np.random.seed(5)  # noqa: NPY002
    torch.manual_seed(5)

    def disturb(row: HistoryRow) -> None:
        np.random.random()  # noqa: NPY002
        torch.rand(3)

    other = train_toy(None, callback=disturb).policy
    np.testing.assert_array_equal(one.layers[0][0], other.layers[0][0])


def test_after_ctrl_c_the_policy_so_far_can_be_driven(tmp_path: Path) -> None:
    with pytest.raises(Stop):
        train_toy(tmp_path, callback=stop_after(5))
    policy = Policy.load(tmp_path / POLICY)
    assert policy.metadata["steps"] == 240
    assert np.isfinite(policy(demonstrations().states)).all()


def test_a_checkpoint_is_not_overwritten_without_resume(tmp_path: Path) -> None:
    train_toy(tmp_path)
    with pytest.raises(ConflictError, match="--resume goes on"):
        train_toy(tmp_path)


@pytest.mark.parametrize("iterations", [2, 6])
def test_fewer_steps_than_a_policy_has_learned_for_leave_it_alone(
    tmp_path: Path, iterations: int
) -> None:
    train_toy(tmp_path)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    with pytest.raises(ConflictError, match="expected at least the 560 that the policy"):
        train_toy(tmp_path, steps=iterations * 80, resume=True)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_a_checkpoint_of_another_run_is_refused_with_the_difference(tmp_path: Path) -> None:
    train_toy(tmp_path)
    with pytest.raises(ConflictError, match=r"kl 0.01 as before, found 0.02"):
        train_toy(tmp_path, kl=0.02, resume=True)
    with pytest.raises(ConflictError, match="'ssil' as before, found 'gail'"):
        train_toy(tmp_path, "gail", resume=True)
    with pytest.raises(ConflictError, match="run 'toy' as before, found 'other'"):
        train_toy(tmp_path, run="other", resume=True)


def test_the_curve_has_a_row_per_iteration_and_scores_where_they_are_due(tmp_path: Path) -> None:
    result = train_toy(tmp_path)
    rows = list(csv.DictReader((tmp_path / CURVE).read_text().splitlines()))
    assert [int(row["steps"]) for row in rows] == [80 * k for k in range(8)]
    scored = [k for k, row in enumerate(rows) if row["score"]]
    assert scored == [0, 2, 4, 6, 7]
    last = result.curve[-1].evaluation
    assert float(rows[-1]["score"]) == last.score == last.mean / -2.0
    assert rows[1]["eta"] and rows[1]["accuracy"] and rows[1]["kl"]


def test_the_policy_file_says_how_it_was_trained(tmp_path: Path) -> None:
    train_toy(tmp_path)
    metadata = json.loads(json.dumps(Policy.load(tmp_path / POLICY).metadata))
    assert metadata["method"] == "ssil"
    assert metadata["origin"] == {"run": "toy"}
    assert metadata["settings"]["hidden"] == 8
    assert metadata["steps"] == metadata["evaluated"]["steps"] == 560


def test_torch_keeps_its_threads(tmp_path: Path) -> None:
    before = torch.get_num_threads()
    train_toy(None, steps=1)
    assert torch.get_num_threads() == before


def test_a_method_of_no_iterations_gives_its_cloned_policy(tmp_path: Path) -> None:
    result = train_toy(tmp_path, "clone")
    assert len(result.curve) == 1
    assert result.curve[0].evaluation is not None
    assert (tmp_path / POLICY).exists()
    with pytest.raises(ConflictError, match="--resume goes on"):
        train_toy(tmp_path, "clone", cloning_steps=7)
    again = train_toy(tmp_path, "clone", resume=True)
    np.testing.assert_array_equal(again.policy.layers[0][0], result.policy.layers[0][0])


@pytest.mark.parametrize(
    "method", ["clone", "clone-mixed", "clone-leverage", "clone-shuffled", "gail"]
)
def test_weight_decay_shrinks_every_clone_and_is_part_of_the_record(
    tmp_path: Path, method: str
) -> None:
    """Of `gail`, the policy before the first step in the environment."""
    steps = {"steps": 0, "cloning_steps": 200}
    squares = []
    files = []
    for name, more in (
        ("usual", {}),
        ("off", {"cloning_weight_decay": 0.0}),
        ("on", {"cloning_weight_decay": 5.0}),
    ):
        policy = train_toy(tmp_path / name, method, **steps, **more).policy
        squares.append(sum(float(np.square(weight).sum()) for weight, _ in policy.layers))
        files.append((tmp_path / name / POLICY).read_bytes())
    assert files[0] == files[1]
    assert squares[0] == squares[1] > 1.5 * squares[2]
    stored = Policy.load(tmp_path / "on" / POLICY).metadata["settings"]
    assert stored["cloning_weight_decay"] == 5.0
    with pytest.raises(ConflictError, match=r"cloning_weight_decay 5.0 as before, found 0.0"):
        train_toy(tmp_path / "on", method, resume=True, **steps)


@pytest.mark.parametrize(
    "wrong",
    [
        {"kl": 0.0},
        {"discount": 1.5},
        {"seed": -1},
        {"eta": float("nan")},
        {"log_sigma": np.inf},
        {"cloning_weight_decay": -0.1},
        {"cloning_weight_decay": float("nan")},
        {"cloning_weight_decay": np.inf},
        {"cloning_weight_decay": 1001.0},
        {"cloning_weight_decay": 11.0, "cloning_rate": 0.1},
    ],
    ids=str,
)
def test_settings_that_make_no_sense_are_refused(wrong: dict) -> None:
    with pytest.raises(InvalidInputError, match=next(iter(wrong))):
        TrainSettings(**wrong)
