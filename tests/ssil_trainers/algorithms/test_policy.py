"""The policy file and the action box."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from ssil_data.errors import DamagedError, InvalidInputError, NotFoundError
from ssil_data.features import Standardizer
from ssil_trainers.algorithms import tensor_file
from ssil_trainers.algorithms.networks import PolicyNetwork
from ssil_trainers.algorithms.policy import ActionBox, Policy

BOX = ActionBox(np.array([-2.0, 0.0], np.float32), np.array([2.0, 10.0], np.float32))


def policy() -> Policy:
    torch.manual_seed(0)
    network = PolicyNetwork(3, 2, 8, -0.7)
    torch.nn.init.normal_(network.mean[-1].weight)
    standardizer = Standardizer(np.arange(3, dtype=np.float32), np.full(3, 2, np.float32))
    sigma = network.log_sigma.detach().numpy()
    return Policy(standardizer, network.layers(), sigma, BOX, {"method": "none"})


STATES = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32) * 4


def test_the_mean_is_that_of_the_network_of_standardized_states() -> None:
    torch.manual_seed(0)
    network = PolicyNetwork(3, 2, 8, -0.7)
    torch.nn.init.normal_(network.mean[-1].weight)
    expected = network(torch.from_numpy((STATES - np.arange(3, dtype=np.float32)) / 2)).mean
    np.testing.assert_allclose(policy().mean(STATES), expected.detach(), rtol=1e-5, atol=1e-6)


def test_actions_lie_in_the_box_and_reach_its_walls() -> None:
    actions = policy()(STATES)
    assert actions.dtype == np.float32
    assert (actions.min(axis=0) == BOX.low).all() and (actions.max(axis=0) == BOX.high).all()


def test_the_box_maps_to_unit_actions_and_back() -> None:
    actions = np.array([[-2, 0], [2, 10], [0, 5], [1, 2.5]], np.float32)
    unit = BOX.to_unit(actions)
    np.testing.assert_allclose(unit, [[-1, -1], [1, 1], [0, 0], [0.5, -0.5]])
    np.testing.assert_allclose(BOX.from_unit(unit), actions)
    np.testing.assert_array_equal(BOX.to_unit(actions * 9)[1], [1, 1])


@pytest.mark.parametrize("high", [np.inf, -2.0])
def test_a_box_without_bounds_or_width_is_refused(high: float) -> None:
    with pytest.raises(InvalidInputError, match="every action needs finite bounds"):
        ActionBox(np.array([-2.0], np.float32), np.array([high], np.float32))


def test_saved_and_loaded_a_policy_acts_the_same_and_keeps_its_metadata(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "policy.safetensors"
    policy().save(path)
    loaded = Policy.load(path)
    np.testing.assert_array_equal(loaded(STATES), policy()(STATES))
    assert loaded.metadata["method"] == "none"
    first = path.read_bytes()
    loaded.save(path)
    assert path.read_bytes() == first
    assert [one.name for one in path.parent.iterdir()] == [path.name]


def test_a_file_that_is_not_a_policy_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    with pytest.raises(NotFoundError):
        Policy.load(path)
    path.write_bytes(b"\x80\x04\x95")
    with pytest.raises(DamagedError):
        Policy.load(path)
    tensor_file.write(path, {"a": np.zeros(2)}, {"kind": "another thing"})
    with pytest.raises(InvalidInputError, match="expected a ssil policy, found a another thing"):
        Policy.load(path)
    tensor_file.write(path, {"a": np.zeros(2)}, {"kind": "ssil policy"})
    with pytest.raises(DamagedError):
        Policy.load(path)


def test_a_cut_or_infinite_file_is_damaged(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    policy().save(path)
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(DamagedError):
        Policy.load(path)
    tensor_file.write(path, {"a": np.array([np.inf])}, {"kind": "thing"})
    with pytest.raises(DamagedError, match="finite"):
        tensor_file.read(path, "thing")


def test_metadata_that_json_cannot_hold_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    with pytest.raises(ValueError):
        tensor_file.write(path, {}, {"kind": "thing", "score": float("nan")})
    assert not path.exists()
    tensor_file.write(path, {"a": np.arange(3)}, {"kind": "thing", "list": [1, None]})
    arrays, metadata = tensor_file.read(path, "thing")
    assert metadata == {"kind": "thing", "list": [1, None]}
    assert arrays["a"].tolist() == [0, 1, 2]
