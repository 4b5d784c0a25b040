"""The policy as plain arrays: what acts during training, and what a policy file holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import DamagedError, InvalidInputError
from ssil_data.features import Standardizer
from ssil_trainers.algorithms import tensor_file

KIND = "ssil policy"
"""What a policy file says that it is."""

Layer = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Weight (in, out) and bias (out,) of a linear layer."""


@dataclass(frozen=True, eq=False)
class ActionBox:
    """The range of an environment's actions, and its mapping to unit actions in [−1, 1].

    Parameters
    ----------
    low:
        Smallest value of each action, (k,).
    high:
        Largest value, (k,); finite and above `low`.

    Raises
    ------
    InvalidInputError
        For bounds that are infinite or have no width.

    Examples
    --------
    >>> box = ActionBox(np.array([0], np.float32), np.array([10], np.float32))
    >>> box.to_unit(np.array([[0], [5], [99]], np.float32)).ravel()
    array([-1.,  0.,  1.], dtype=float32)
    >>> box.from_unit(np.array([[0.5]], np.float32))
    array([[7.5]], dtype=float32)
    """

    low: NDArray[np.float32]
    high: NDArray[np.float32]

    def __post_init__(self) -> None:
        """Refuse a box without width or bounds."""
        width = np.asarray(self.high, np.float64) - self.low
        if not (np.isfinite(width) & (width > 0)).all():
            raise InvalidInputError(
                "action space: every action needs finite bounds, the lower below the upper: found "
                f"{self.low} to {self.high}"
            )

    def to_unit(self, actions: NDArray[np.float32]) -> NDArray[np.float32]:
        """Clip actions (n, k) to the box and map it to [−1, 1], (n, k).

        Parameters
        ----------
        actions:
            Actions in raw units, (n, k).
        """
        inside = np.clip(actions, self.low, self.high)
        unit = 2 * (inside - self.low) / (self.high - self.low) - 1
        return unit.astype(np.float32)

    def from_unit(self, unit: NDArray[np.float32]) -> NDArray[np.float32]:
        """Clip unit actions (n, k) to [−1, 1] and map them to the box, (n, k).

        Parameters
        ----------
        unit:
            Unit actions, (n, k).
        """
        share = (np.clip(unit, -1, 1) + 1) / 2
        return (self.low + share * (self.high - self.low)).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Policy:
    """A Gaussian policy over unit actions; calling it gives the mean action.

    Parameters
    ----------
    standardizer:
        Standardization of states, by all demonstrations.
    layers:
        Layers of the mean: a tanh network of the standardized state.
    log_sigma:
        Logarithm of the deviation of each unit action, (k,), the same in every state.
    box:
        Range of the environment's actions.
    metadata:
        Where the policy comes from, as JSON.

    Examples
    --------
    >>> policy = Policy(
    ...     standardizer=Standardizer(np.zeros(1, np.float32), np.ones(1, np.float32)),
    ...     layers=((np.ones((1, 1), np.float32), np.zeros(1, np.float32)),),
    ...     log_sigma=np.zeros(1, np.float32),
    ...     box=ActionBox(np.array([-2], np.float32), np.array([2], np.float32)),
    ... )
    >>> policy(np.array([[0.25], [3]], np.float32))
    array([[0.5],
           [2. ]], dtype=float32)
    >>> policy.save(Path("policy.safetensors"))
    >>> Policy.load(Path("policy.safetensors")).log_sigma
    array([0.], dtype=float32)
    """

    standardizer: Standardizer
    layers: tuple[Layer, ...]
    log_sigma: NDArray[np.float32]
    box: ActionBox
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, states: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the mean actions (n, k), within the box, of states (n, d) in raw units.

        Parameters
        ----------
        states:
            States in raw units, (n, d).
        """
        return self.box.from_unit(self.mean(states))

    def mean(self, states: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the mean unit actions (n, k) of states (n, d) in raw units, not clipped.

        Parameters
        ----------
        states:
            States in raw units, (n, d).
        """
        x = self.standardizer(states)
        for weight, bias in self.layers[:-1]:
            x = x @ weight
            x += bias
            np.tanh(x, out=x)
        weight, bias = self.layers[-1]
        return x @ weight + bias

    def save(self, path: Path) -> None:
        """Write the policy file: safetensors, with the metadata in its header.

        Parameters
        ----------
        path:
            The file; its folder is made if it is missing.
        """
        arrays = {
            "shift": self.standardizer.shift,
            "scale": self.standardizer.scale,
            "log_sigma": self.log_sigma,
            "low": self.box.low,
            "high": self.box.high,
        }
        for number, (weight, bias) in enumerate(self.layers):
            arrays[f"{number}.weight"] = weight
            arrays[f"{number}.bias"] = bias
        tensor_file.write(path, arrays, {**self.metadata, "kind": KIND})

    @classmethod
    def load(cls, path: Path) -> Policy:
        """Read a policy file; nothing in it is executed.

        Parameters
        ----------
        path:
            The file that `save` wrote.

        Raises
        ------
        NotFoundError
            If there is no such file.
        InvalidInputError
            If it is of another kind.
        DamagedError
            If it is cut off, or its arrays do not fit together.
        """
        arrays, metadata = tensor_file.read(path, KIND)
        try:
            policy = cls(
                Standardizer(arrays["shift"], arrays["scale"]),
                _read_layers(arrays),
                arrays["log_sigma"],
                ActionBox(arrays["low"], arrays["high"]),
                metadata,
            )
            policy(np.zeros((1, policy.standardizer.width), np.float32))
        except (KeyError, IndexError, ValueError) as error:
            raise DamagedError(f"{path}: its arrays do not make a policy: {error}") from None
        return policy


def _read_layers(arrays: Mapping[str, NDArray[Any]]) -> tuple[Layer, ...]:
    """Collect the layers of a policy file, which has five arrays beside two for every layer."""
    count = len(arrays) // 2 - 2
    return tuple((arrays[f"{n}.weight"], arrays[f"{n}.bias"]) for n in range(count))
