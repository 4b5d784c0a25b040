"""The loop: every method solves the toy, what ignores its input does not, η follows its rule."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from ssil_trainers.adversarial import Learner, decayed
from ssil_trainers.methods import METHODS
from ssil_trainers.rollout import Driver
from ssil_trainers.settings import TrainSettings
from ssil_trainers.training import Job, Trained, train
from toy import STEPS, Line, demonstrations, expert, mean_return

TOY = TrainSettings(
    steps=50 * 16 * STEPS,
    environments=16,
    horizon=STEPS,
    hidden=32,
    discount=0.9,
    kl=0.03,
    entropy=0.0,
    centred=False,
    critic_rate=3e-3,
    discriminator_rate=3e-3,
    discriminator_steps=20,
    discriminator_batch=64,
    cloning_steps=600,
    evaluate_every=100,
)
EXPERT = mean_return(expert)
IGNORING = max(
    mean_return(lambda states, a=a: np.full((len(states), 1), a)) for a in (-1.0, -0.3, 0, 0.3, 1.0)
)
"""The best that one and the same action everywhere can do."""


def trained(method: str, settings: TrainSettings = TOY) -> Trained:
    return train(Job(method, settings, demonstrations(), Line, {}))


def test_the_toy_tells_experts_from_those_who_do_not_look() -> None:
    assert EXPERT > -2
    assert IGNORING < -10


@pytest.mark.parametrize(
    "method", ["gail", "gail-mixed", "mixgail", "ssil", "ssil-leverage", "clone", "clone-leverage"]
)
def test_every_method_solves_the_toy(method: str) -> None:
    assert mean_return(trained(method).policy) > -4


def test_a_constant_reward_teaches_nothing() -> None:
    assert mean_return(trained("constant").policy) < -7


@pytest.mark.parametrize(
    "option",
    [
        {"centred": True},
        {"gradient_penalty": 0.1},
        {"spectral_norm": True},
        {"pretrained": True, "steps": 5 * 16 * STEPS},
    ],
    ids=lambda option: next(iter(option)),
)
def test_ssil_solves_the_toy_with_every_option(option: dict) -> None:
    assert mean_return(trained("ssil", replace(TOY, **option)).policy) > -7


def test_gail_never_learns_a_value_of_the_shaping() -> None:
    learner = learner_of("gail")
    learner.iterate()
    of_c = learner.critics(learner._seen(learner.initial))[1]
    assert not of_c.detach().numpy().any()


def test_the_shaping_reaches_the_policy_and_never_the_discriminator() -> None:
    """With a discriminator that learns nothing, LCoR alone moves the point to good states."""
    settings = replace(TOY, discriminator_steps=0, eta=5.0, eta_decay=1.0)
    last = trained("ssil", settings).curve[-1].iteration
    first = trained("ssil", replace(settings, steps=1)).curve[-1].iteration
    assert last.shaping > first.shaping
    assert last.discriminator_reward == pytest.approx(np.log(2))
    gail, ssil = learner_of("gail"), learner_of("ssil")
    one, other = gail.iterate(), ssil.iterate()
    assert (one.accuracy, one.discriminator_reward) == (other.accuracy, other.discriminator_reward)
    assert one.shaping == 0 < other.shaping
    weights = [each.policy.layers()[0][0] for each in (gail, ssil)]
    assert (weights[0] != weights[1]).any()


@pytest.mark.parametrize(
    ("rise_d", "rise_c", "expected"), [(0.2, 0.1, 0.45), (0.1, 0.2, 0.5), (0.1, 0.1, 0.5)]
)
def test_eta_decays_when_the_discriminators_value_rises_more(
    rise_d: float, rise_c: float, expected: float
) -> None:
    assert decayed(0.5, 0.9, rise_d=rise_d, rise_c=rise_c) == pytest.approx(expected)


def test_eta_follows_the_rule_in_the_loop() -> None:
    learner = learner_of("ssil")
    eta = learner.eta
    for _ in range(6):
        before = learner.critics(learner._seen(learner.initial)).mean(dim=1).tolist()
        learner.iterate()
        after = learner.critics(learner._seen(learner.initial)).mean(dim=1).tolist()
        rises = after[0] - before[0], after[1] - before[1]
        eta *= TOY.eta_decay if rises[0] > rises[1] else 1
        assert learner.eta == pytest.approx(eta)


def learner_of(
    method: str, settings: TrainSettings = TOY, world: Callable[[int], Line] = Line
) -> Learner:
    of, row, driver = demonstrations(), METHODS[method], Driver(world(settings.environments))
    experts = row.imitated(of, driver.box, of.standardiser)
    learner = Learner(
        settings,
        driver=driver,
        experts=experts,
        shaping=row.shaping(of, settings.seed),
        standardiser=of.standardiser,
    )
    learner.start_anew()
    return learner


def test_a_centred_shaping_pays_nobody_for_staying_alive() -> None:
    """LCoR that is the same everywhere moves nothing when it is centred."""
    plain, centred, gail = learner_of("ssil"), learner_of("ssil"), learner_of("gail")
    centred.settings = replace(TOY, centred=True)
    for learner in (plain, centred):
        learner.shaping = lambda states: np.full(len(states), 0.7)
    for learner in (plain, centred, gail):
        assert learner.iterate().shaping == pytest.approx(0 if learner is gail else 0.7)
    weights = [learner.policy.layers()[0][0] for learner in (plain, centred, gail)]
    np.testing.assert_allclose(weights[1], weights[2], atol=1e-6)
    assert np.abs(weights[0] - weights[2]).max() > 1e-4


def test_the_environments_reward_is_not_read() -> None:
    class Lying(Line):
        def step(self, actions):
            state, reward, *rest = super().step(actions)
            return state, np.full_like(reward, np.nan), *rest

    learner = learner_of("ssil")
    lied_to = learner_of("ssil")
    lied_to.driver = Driver(Lying(TOY.environments))
    lied_to.start_anew()
    assert lied_to.iterate() == learner.iterate()
