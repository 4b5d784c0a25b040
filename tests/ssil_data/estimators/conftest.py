"""Demonstrations whose quality is known, and every estimator fitted to the best of them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ssil_data.demonstrations import Pairs, join_pairs
from ssil_data.estimators import (
    GPR,
    MDN,
    VAE,
    Contrast,
    Ensemble,
    Estimator,
    Fitted,
    UnlabeledSample,
    WindowVAE,
)

FEW_STEPS = (
    GPR(learn_on=100, inducing=64, steps=2, surprisal=True),
    MDN(steps=100, surprisal=True),
    WindowVAE(steps=200),
    Contrast(expert_share=0.5, steps=60),
)
"""The members of the default ensemble, learned for a shorter time."""

EVERY = [
    VAE(),
    WindowVAE(),
    MDN(),
    GPR(),
    Contrast(expert_share=0.5, steps=120),
    Ensemble(FEW_STEPS),
    MDN(surprisal=True),
    GPR(surprisal=True),
]
"""All estimators, with every option that changes what they judge."""


def steered(seed: int, *, noise: float) -> Pairs:
    """10 episodes × 30 steps: a point is steered to the origin and seen through six sensors.

    The expert's actions are exact up to 5 % noise; more noise makes a worse demonstration.
    """
    rng = np.random.default_rng(seed)
    sensors = np.random.default_rng(7).normal(size=(4, 6))
    states, actions = [], []
    for _ in range(10):
        place, speed = rng.uniform(-1, 1, 2), np.zeros(2)
        for _ in range(30):
            action = -1.5 * place - 1.2 * speed + noise * rng.normal(size=2)
            states.append(np.tanh(np.r_[place, speed] @ sensors) + 0.01 * rng.normal(size=6))
            actions.append(action)
            place, speed = place + 0.2 * speed, speed + 0.2 * action
    episode, step = np.divmod(np.arange(300), 30)
    return Pairs(np.array(states), np.array(actions), episode, step)


@pytest.fixture(scope="session")
def expert() -> Pairs:
    """Labeled pairs."""
    return steered(0, noise=0.05)


@pytest.fixture(scope="session")
def other_expert() -> Pairs:
    """Expert pairs that no estimator was fitted to."""
    return steered(1, noise=0.05)


@pytest.fixture(scope="session")
def random() -> Pairs:
    """Pairs of a driver whose actions are mostly noise."""
    return steered(2, noise=3.0)


@pytest.fixture(scope="session")
def unlabeled() -> UnlabeledSample:
    """Pairs of both, which no estimator is told the quality of; another pool than is judged."""
    ours, others = steered(3, noise=0.05), steered(4, noise=3.0)
    others = Pairs(others.states, others.actions, others.episode + 10, others.step)
    return UnlabeledSample.of(join_pairs([ours, others]))


NAMES = [
    f"{each.kind} with surprisal" if getattr(each, "surprisal", False) else each.kind
    for each in EVERY
]


@pytest.fixture(scope="session", params=EVERY, ids=NAMES)
def estimator(request: pytest.FixtureRequest) -> Estimator:
    """Each estimator in turn."""
    return request.param


@pytest.fixture(scope="session")
def brief(estimator: Estimator) -> Estimator:
    """The same, learned for a shorter time: for what does not depend on how well it has learned."""
    steps = getattr(estimator, "steps", None)
    return estimator if steps is None else replace(estimator, steps=min(steps, 150))


@pytest.fixture(scope="session")
def fit(expert: Pairs, unlabeled: UnlabeledSample) -> Callable[[Estimator], Fitted]:
    """Fit to the expert with seed 0, once per settings and session."""
    known: dict[Estimator, Fitted] = {}

    def fit_once(estimator: Estimator) -> Fitted:
        if estimator not in known:
            known[estimator] = estimator.fit(expert, seed=0, unlabeled=unlabeled)
        return known[estimator]

    return fit_once


@pytest.fixture
def fitted(estimator: Estimator, fit: Callable[[Estimator], Fitted]) -> Fitted:
    """Each estimator fitted to the expert."""
    return fit(estimator)
