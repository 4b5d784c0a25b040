"""Steps of Adam whose rate falls to zero as a cosine."""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch
from torch import Tensor
from torch.optim.adam import adam


class Adam:
    """Changes weights by Adam (Kingma and Ba, 2015), its rate falling to zero as a cosine.

    The arithmetic is that of `torch.optim.Adam` under `CosineAnnealingLR`, bit for bit. The classes
    themselves import torch's compiler at their first use, which takes a new process a second.

    Parameters
    ----------
    weights
        What is changed.
    steps
        Steps until the rate is zero.
    rate
        Learning rate of the first step.
    """

    def __init__(self, weights: Iterable[Tensor], *, steps: int, rate: float) -> None:
        self._weights = list(weights)
        self._means = [torch.zeros_like(weight) for weight in self._weights]
        self._squares = [torch.zeros_like(weight) for weight in self._weights]
        self._counts = [torch.zeros(()) for _ in self._weights]
        self._steps = steps
        self._rate = rate
        self._done = 0

    def step(self, loss: Tensor) -> None:
        """Change the weights so that a loss falls.

        Parameters
        ----------
        loss
            A number that was computed from all the weights.
        """
        gradients = torch.autograd.grad(loss, self._weights)
        with torch.no_grad():
            adam(
                self._weights,
                list(gradients),
                self._means,
                self._squares,
                [],
                self._counts,
                fused=True,
                amsgrad=False,
                beta1=0.9,
                beta2=0.999,
                lr=self._rate,
                weight_decay=0.0,
                eps=1e-8,
                maximize=False,
            )
        self._done += 1
        self._rate *= _height(self._done, self._steps) / _height(self._done - 1, self._steps)


def _height(done: int, steps: int) -> float:
    """Return twice the share of the first rate that is left after some steps."""
    return 1 + math.cos(math.pi * done / steps)
