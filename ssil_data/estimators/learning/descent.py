"""Gradient descent that depends on its seed alone and leaves torch as it was."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ssil_data.estimators.learning.adam import Adam
from ssil_data.estimators.perceptron import Perceptron

_ONE_AT_A_TIME = Lock()
"""Generator and thread count belong to the whole process, so fits in several threads take turns."""


@contextmanager
def reproducible(seed: int) -> Iterator[None]:
    """Seed torch and use one thread inside: faster on small steps, and sums keep their order.

    Parameters
    ----------
    seed
        Of torch's generator; the generator is restored on leaving.
    """
    with _ONE_AT_A_TIME, torch.random.fork_rng(devices=[]):
        threads = torch.get_num_threads()
        torch.manual_seed(seed)
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(threads)


def network(inputs: int, hidden: int, outputs: int) -> nn.Sequential:
    """Build the network that `perceptron` turns into arrays.

    Parameters
    ----------
    inputs, hidden, outputs
        Widths of its layers.
    """
    return nn.Sequential(nn.Linear(inputs, hidden), nn.Tanh(), nn.Linear(hidden, outputs))


def perceptron(learned: nn.Sequential) -> Perceptron:
    """Copy a trained network's weights into plain arrays.

    Parameters
    ----------
    learned
        What `network` built.
    """
    inner, inner_bias, outer, outer_bias = (
        np.ascontiguousarray(parameter.detach().numpy().T) for parameter in learned.parameters()
    )
    return Perceptron(inner, inner_bias, outer, outer_bias)


def descend(
    loss: Callable[..., Tensor],
    data: tuple[NDArray[np.float32], ...],
    networks: list[nn.Module],
    *,
    steps: int,
    batch: int,
    rate: float,
) -> None:
    """Minimize a mean loss by Adam, its rate falling to zero as a cosine.

    Parameters
    ----------
    loss
        Maps some rows of each array of `data` to their mean loss.
    data
        Arrays of n rows.
    networks
        Those whose weights are changed.
    steps
        Steps of Adam.
    batch
        Rows that each step draws, with replacement.
    rate
        Learning rate of the first step.
    """
    for _ in take_steps(loss, data, networks, steps=steps, batch=batch, rate=rate):
        pass


def take_steps(
    loss: Callable[..., Tensor],
    data: tuple[NDArray[np.float32], ...],
    networks: list[nn.Module],
    *,
    steps: int,
    batch: int,
    rate: float,
) -> Iterator[int]:
    """Yield after each step of `descend`, so that a caller can look in between, or end early.

    Parameters
    ----------
    loss, data, networks, steps, batch, rate
        Of `descend`.

    Yields
    ------
    int
        How many steps are taken.
    """
    parameters = [parameter for network in networks for parameter in network.parameters()]
    adam = Adam(parameters, steps=steps, rate=rate)
    tensors = [torch.from_numpy(array) for array in data]
    for done, rows in enumerate(torch.randint(len(data[0]), (steps, batch)), start=1):
        adam.step(loss(*(tensor[rows] for tensor in tensors)))
        yield done
