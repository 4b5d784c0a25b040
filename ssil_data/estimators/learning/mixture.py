"""Learning a mixture density network by its likelihood."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, log_softmax, logsumexp, nn

from ssil_data.estimators.learning.descent import network, perceptron, reproducible, take_steps
from ssil_data.estimators.perceptron import Perceptron

EVERY = 10
"""Steps of Adam between two looks at the pairs that are held out."""


@dataclass(frozen=True)
class MixtureLearner:
    """Trains the network of a mixture of normal actions; minimizes −log p(a | s) (Bishop, 1994).

    Parameters
    ----------
    components
        Normal distributions in the mixture, K.
    hidden
        Width of the hidden layer.
    floor
        Least variance of a component, added to exp(log variance).
    steps, batch, rate
        Of Adam, see `descend`.
    seed
        Sets the first weights and the batches.
    """

    components: int
    hidden: int
    floor: float
    steps: int
    batch: int
    rate: float
    seed: int

    def learn(
        self,
        states: NDArray[np.float32],
        actions: NDArray[np.float32],
        *,
        last: int | None = None,
    ) -> Perceptron:
        """Train on pairs.

        Parameters
        ----------
        states, actions
            Standardized pairs, (n, d) and (n, k).
        last
            The step after which to end, before the rate has fallen to zero; None takes them all.

        Returns
        -------
        Perceptron
            The network: state (d) → logits (K), means (K·k), log variances (K·k).
        """
        with reproducible(self.seed):
            mixture = self._make_network(states.shape[1], actions.shape[1])
            for done in self._take_steps(mixture, states, actions):
                if done == last:
                    break
        return perceptron(mixture)

    def find_best_step(
        self,
        states: NDArray[np.float32],
        actions: NDArray[np.float32],
        *,
        held_out: tuple[NDArray[np.float32], NDArray[np.float32]],
    ) -> int:
        """Return after how many steps the loss of pairs that are held out is least.

        All steps are taken, and every tenth of them is looked at: a loss that rises for a while and
        falls again ends nothing.

        Parameters
        ----------
        states, actions
            Standardized pairs to train on, (n, d) and (n, k).
        held_out
            Standardized states and actions of other pairs, at least one.
        """
        losses: dict[int, float] = {}
        with reproducible(self.seed):
            mixture = self._make_network(states.shape[1], actions.shape[1])
            loss = self._make_loss(mixture, actions.shape[1])
            tensors = [torch.from_numpy(array) for array in held_out]
            for done in self._take_steps(mixture, states, actions):
                if done % EVERY == 0 or done == self.steps:
                    with torch.no_grad():
                        losses[done] = float(loss(*tensors))
        return min(losses, key=lambda step: losses[step])

    def _make_network(self, state_width: int, action_width: int) -> nn.Sequential:
        return network(state_width, self.hidden, self.components * (1 + 2 * action_width))

    def _take_steps(
        self, mixture: nn.Sequential, states: NDArray[np.float32], actions: NDArray[np.float32]
    ) -> Iterator[int]:
        """Train step by step; yield the number of each."""
        return take_steps(
            self._make_loss(mixture, actions.shape[1]),
            (states, actions),
            [mixture],
            steps=self.steps,
            batch=self.batch,
            rate=self.rate,
        )

    def _make_loss(self, mixture: nn.Sequential, width: int) -> Callable[[Tensor, Tensor], Tensor]:
        """Return the loss: the mean surprisal of actions in their states, in nats."""
        count = self.components

        def loss(s: Tensor, a: Tensor) -> Tensor:
            logits, mean, raw = mixture(s).split([count, count * width, count * width], dim=1)
            shape = (-1, count, width)
            variance = raw.reshape(shape).exp() + self.floor
            distance = (a.unsqueeze(1) - mean.reshape(shape)).square() / variance
            log_density = -(distance + variance.log() + math.log(2 * math.pi)).sum(dim=2) / 2
            return -logsumexp(log_softmax(logits, dim=1) + log_density, dim=1).mean()

        return loss
