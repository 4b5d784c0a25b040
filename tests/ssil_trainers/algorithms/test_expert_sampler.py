"""Who is imitated, by which shaping: the rows of the table of methods and what they draw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from ssil_data.errors import InvalidInputError
from ssil_data.features import Standardizer
from ssil_data.field import auto_alpha
from ssil_trainers.algorithms.behavior_cloning import clone
from ssil_trainers.algorithms.discriminator import DiscriminatorUpdate
from ssil_trainers.algorithms.expert_sampler import ExpertSampler
from ssil_trainers.algorithms.methods import METHODS, Demonstrations
from ssil_trainers.algorithms.networks import Discriminator, PolicyNetwork
from ssil_trainers.algorithms.policy import ActionBox
from support.toy_environment import demonstrations

BOX = ActionBox(np.full(1, -2, np.float32), np.full(1, 2, np.float32))


def numbered(weight: list[float]) -> ExpertSampler:
    """Experts whose state is their number."""
    column = np.arange(len(weight), dtype=np.float32)[:, None]
    return ExpertSampler(column, -column, np.array(weight, np.float32))


def test_pairs_are_drawn_by_their_weight_and_stay_together() -> None:
    states, actions = numbered([0, 1, 3, 0]).draw(4000, np.random.default_rng(0))
    assert torch.equal(states, -actions)
    assert set(states.ravel().tolist()) == {1, 2}
    assert float((states == 2).float().mean()) == pytest.approx(0.75, abs=0.03)


@pytest.mark.parametrize("weight", [[0.0, 0.0], [1.0, -0.1]])
def test_weights_of_nobody_or_below_zero_are_refused(weight: list[float]) -> None:
    with pytest.raises(InvalidInputError, match="weights"):
        numbered(weight)


def test_unequal_lengths_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="equal lengths"):
        ExpertSampler(np.zeros((2, 1)), np.zeros((3, 1)), np.ones(2))
    of = demonstrations()
    with pytest.raises(InvalidInputError, match="equal lengths"):
        Demonstrations(of.states, of.actions[1:], of.labeled)
    with pytest.raises(InvalidInputError, match="labeled"):
        Demonstrations(of.states, of.actions, np.zeros(len(of.states), bool))


@pytest.mark.parametrize(
    ("method", "pairs"),
    [
        ("gail", 300),
        ("gail-mixed", 1500),
        ("mixgail", 300),
        ("ssil", 300),
        ("shuffled", 300),
        ("constant", 300),
        ("clone", 300),
        ("clone-mixed", 1500),
    ],
)
def test_experts_are_the_labeled_pairs_unless_everything_is_taken(method: str, pairs: int) -> None:
    of = demonstrations()
    experts = METHODS[method].expert_sampler(of, BOX, of.standardizer)
    assert len(experts.states) == pairs
    np.testing.assert_array_equal(experts.weight, np.ones(pairs))
    np.testing.assert_array_equal(experts.states, of.standardizer(of.states[:pairs]))
    np.testing.assert_allclose(experts.actions, np.clip(of.actions[:pairs], -2, 2) / 2, atol=1e-6)


@pytest.mark.parametrize("method", ["gail-leverage", "ssil-leverage", "clone-leverage"])
def test_leverage_is_the_weight_where_everything_is_taken_by_leverage(method: str) -> None:
    of = demonstrations()
    experts = METHODS[method].expert_sampler(of, BOX, of.standardizer)
    np.testing.assert_array_equal(experts.weight, of.leverage)
    np.testing.assert_array_equal(experts.states, of.standardizer(of.states))


def test_methods_differ_by_the_shaping() -> None:
    of = demonstrations()
    states = of.states[:7] + 0.1
    shaped = {name: METHODS[name].shaping(of, 0)(states) for name in METHODS}
    assert not shaped["gail"].any() and not shaped["constant"].any()
    np.testing.assert_array_equal(shaped["ssil"], of.field.lcor(states).values)
    np.testing.assert_array_equal(shaped["mixgail"], of.field.cor(states))
    mixed = of.field.lcor(states).values - shaped["shuffled"]
    assert np.abs(mixed).max() > 0.01


def test_shuffled_leverage_has_the_same_values_and_follows_the_seed() -> None:
    of, states = demonstrations(), demonstrations().states[:50]
    one, again, other = (METHODS["shuffled"].shaping(of, seed)(states) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one, again)
    assert (one != other).any()
    mean = float(of.leverage.mean())
    assert one.mean() == pytest.approx(mean, abs=0.03)


def test_mixgail_without_a_run_fits_its_own_kernel() -> None:
    of = demonstrations()
    alone = METHODS["mixgail"].shaping(replace(of, leverage=None, field=None), 0)
    fitted = of.field_of(of.leverage, auto_alpha(of.standardizer(of.states)))
    np.testing.assert_array_equal(alone(of.states[:50]), fitted.cor(of.states[:50]))
    given = METHODS["mixgail"].shaping(of, 0)
    np.testing.assert_array_equal(given(of.states[:50]), of.field.cor(of.states[:50]))
    assert not METHODS["mixgail"].needs_run and METHODS["mixgail"].takes_run


@pytest.mark.parametrize("method", ["ssil", "shuffled", "clone-leverage"])
def test_without_a_run_there_is_no_leverage_to_ask(method: str) -> None:
    of = replace(demonstrations(), leverage=None, field=None)
    row = METHODS[method]
    assert row.needs_run
    with pytest.raises(InvalidInputError, match="run"):
        row.shaping(of, 0)
        row.expert_sampler(of, BOX, of.standardizer)


def pair_tensors(offset: float, count: int = 400) -> torch.Tensor:
    return torch.randn(count, 3, generator=torch.Generator().manual_seed(int(offset))) + offset


@pytest.mark.parametrize("penalty", [0.0, 1.0])
def test_the_discriminator_learns_that_the_policys_pairs_are_high(penalty: float) -> None:
    policy, expert = pair_tensors(1), pair_tensors(-1).numpy()
    experts = ExpertSampler(expert[:, :2], expert[:, 2:], np.ones(len(expert), np.float32))
    discriminator = Discriminator(2, 1, 16, spectral=False)
    adam = torch.optim.Adam(discriminator.parameters(), lr=3e-3)
    teaching = DiscriminatorUpdate(steps=100, batch=64, gradient_penalty=penalty)
    teaching(discriminator, adam, pairs=policy, experts=experts, rng=np.random.default_rng(0))
    accuracy = teaching(
        discriminator, adam, pairs=policy, experts=experts, rng=np.random.default_rng(1)
    )
    assert accuracy > 0.85
    assert float(discriminator(policy).mean().detach()) > 0.3
    assert float(discriminator(torch.from_numpy(expert)).mean().detach()) < -0.3


def test_the_gradient_penalty_keeps_the_discriminator_gentle() -> None:
    policy, expert = pair_tensors(1), pair_tensors(-1).numpy()
    experts = ExpertSampler(expert[:, :2], expert[:, 2:], np.ones(len(expert), np.float32))
    slopes = []
    for penalty in (0.0, 10.0):
        torch.manual_seed(0)
        discriminator = Discriminator(2, 1, 16, spectral=False)
        adam = torch.optim.Adam(discriminator.parameters(), lr=1e-2)
        teaching = DiscriminatorUpdate(steps=200, batch=64, gradient_penalty=penalty)
        teaching(discriminator, adam, pairs=policy, experts=experts, rng=np.random.default_rng(0))
        at = torch.zeros(50, 3, requires_grad=True)
        (slope,) = torch.autograd.grad(discriminator(at).sum(), at)
        slopes.append(float(slope.norm(dim=1).mean()))
    assert slopes[1] == pytest.approx(1, abs=0.3) and slopes[0] > 1.5


def test_without_steps_the_discriminator_stays_as_it_was() -> None:
    discriminator = Discriminator(2, 1, 16, spectral=False)
    adam = torch.optim.Adam(discriminator.parameters())
    experts = ExpertSampler(np.zeros((3, 2)), np.zeros((3, 1)), np.ones(3))
    rng = np.random.default_rng(0)
    nothing = DiscriminatorUpdate(steps=0)(
        discriminator, adam, pairs=pair_tensors(1), experts=experts, rng=rng
    )
    assert nothing == 0.5
    assert not discriminator(pair_tensors(2)).any()


def cloned(weight: np.ndarray) -> PolicyNetwork:
    """Clone pairs of which the first half acts 0.5 · s, the second −0.5 · s."""
    states = np.linspace(-1, 1, 100, dtype=np.float32)[:, None]
    experts = ExpertSampler(np.r_[states, states], np.r_[states, -states] / 2, weight)
    torch.manual_seed(0)
    policy = PolicyNetwork(1, 1, 16, -0.7)
    clone(policy, experts, steps=400, batch=64, rate=1e-2, rng=np.random.default_rng(0))
    return policy


def test_cloning_follows_the_pairs_with_weight_and_leaves_sigma() -> None:
    half = np.repeat(np.array([1, 0], np.float32), 100)
    at = torch.tensor([[0.8], [-0.4]])
    good, bad = cloned(half), cloned(1 - half)
    np.testing.assert_allclose(good(at).mean.detach(), [[0.4], [-0.2]], atol=0.03)
    np.testing.assert_allclose(bad(at).mean.detach(), [[-0.4], [0.2]], atol=0.03)
    assert good.log_sigma.item() == pytest.approx(-0.7)


def test_cloning_meets_weights_between() -> None:
    """The least squares answer to weights 3 and 1 is half of the first."""
    weight = np.repeat(np.array([3, 1], np.float32), 100)
    at = torch.tensor([[0.8], [-0.4]])
    np.testing.assert_allclose(cloned(weight)(at).mean.detach(), [[0.2], [-0.1]], atol=0.06)


def test_states_are_standardised_by_all_demonstrations() -> None:
    of = demonstrations()
    expected = Standardizer.of(of.states)
    np.testing.assert_array_equal(of.standardizer.shift, expected.shift)
    np.testing.assert_array_equal(of.standardizer.scale, expected.scale)
