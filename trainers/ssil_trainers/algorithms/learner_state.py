"""The arrays of networks and optimizers by dotted names, as a checkpoint keeps them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn


def collect_arrays(
    networks: Mapping[str, nn.Module], optimizers: Mapping[str, torch.optim.Optimizer]
) -> dict[str, NDArray[Any]]:
    """Copy all parameters, and the optimizers' moments.

    Parameters
    ----------
    networks:
        Networks by name.
    optimizers:
        Optimizers by name.

    Returns
    -------
    :
        Arrays by names such as `critics.weights.0` and `critic_adam.0.exp_avg`.

    Examples
    --------
    >>> network = nn.Linear(2, 1)
    >>> sorted(collect_arrays({"net": network}, {}))
    ['net.bias', 'net.weight']
    """
    found: dict[str, NDArray[Any]] = {}
    for name, network in networks.items():
        for key, value in network.state_dict().items():
            found[f"{name}.{key}"] = value.numpy().copy()
    for name, optimizer in optimizers.items():
        for number, moments in optimizer.state_dict()["state"].items():
            for key, value in moments.items():
                found[f"{name}.{number}.{key}"] = value.numpy().copy()
    return found


def restore_arrays(
    arrays: Mapping[str, NDArray[Any]],
    networks: Mapping[str, nn.Module],
    optimizers: Mapping[str, torch.optim.Optimizer],
) -> None:
    """Load what `collect_arrays` copied into networks and optimizers of the same shape.

    Parameters
    ----------
    arrays:
        Arrays by dotted names.
    networks:
        Networks by name.
    optimizers:
        Optimizers by name.

    Examples
    --------
    >>> arrays = {"net.weight": np.ones((1, 2), np.float32), "net.bias": np.zeros(1, np.float32)}
    >>> network = nn.Linear(2, 1)
    >>> restore_arrays(arrays, {"net": network}, {})
    >>> network(torch.ones(1, 2)).item()
    2.0
    """
    tensors = {name: torch.from_numpy(np.array(array)) for name, array in arrays.items()}
    for name, network in networks.items():
        network.load_state_dict({key: tensors[f"{name}.{key}"] for key in network.state_dict()})
    for name, optimizer in optimizers.items():
        state: dict[int, dict[str, Tensor]] = {}
        for path, tensor in tensors.items():
            if path.startswith(f"{name}."):
                _, number, key = path.split(".")
                state.setdefault(int(number), {})[key] = tensor
        groups = optimizer.state_dict()["param_groups"]
        optimizer.load_state_dict({"state": state, "param_groups": groups})
