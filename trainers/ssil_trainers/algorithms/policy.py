"""The learned driver as plain arrays: what acts while training, and what a policy file holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import DamagedError, InvalidInputError
from ssil_data.features import Standardizer
from ssil_trainers.algorithms import checkpoint as tensors

KIND = "ssil policy"

Layer = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Weight (in, out) and bias (out,)."""


@dataclass(frozen=True, eq=False)
class ActionBox:
    """The actions that an environment takes, low to high (k,); unit actions are in [-1, 1]."""

    low: NDArray[np.float32]
    high: NDArray[np.float32]

    def __post_init__(self) -> None:
        """Refuse a box without width or bounds."""
        width = np.asarray(self.high, np.float64) - self.low
        if not (np.isfinite(width) & (width > 0)).all():
            raise InvalidInputError(
                f"action space: expected bounds below and above, found {self.low} to {self.high}"
            )

    def to_unit(self, actions: NDArray[np.float32]) -> NDArray[np.float32]:
        """Clip actions (n, k) to the box and map it to [-1, 1]."""
        inside = np.clip(actions, self.low, self.high)
        unit = 2 * (inside - self.low) / (self.high - self.low) - 1
        return unit.astype(np.float32)

    def of_unit(self, unit: NDArray[np.float32]) -> NDArray[np.float32]:
        """Clip unit actions (n, k) and map them to the box."""
        share = (np.clip(unit, -1, 1) + 1) / 2
        return (self.low + share * (self.high - self.low)).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Policy:
    """A Gaussian over unit actions: a tanh network of the standardised state, and log σ (k,).

    `described` says where the policy comes from; it is JSON.
    """

    standardiser: Standardizer
    layers: tuple[Layer, ...]
    log_sigma: NDArray[np.float32]
    box: ActionBox
    described: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, states: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the mean actions (n, k), in the box, of states (n, d) in raw units."""
        return self.box.of_unit(self.mean(states))

    def mean(self, states: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the mean unit actions (n, k) of states (n, d), not clipped."""
        x = self.standardiser(states)
        for weight, bias in self.layers[:-1]:
            x = x @ weight
            x += bias
            np.tanh(x, out=x)
        weight, bias = self.layers[-1]
        return x @ weight + bias

    def save(self, path: Path) -> None:
        """Write the policy file: safetensors, with the description in its header."""
        arrays = {
            "shift": self.standardiser.shift,
            "scale": self.standardiser.scale,
            "log_sigma": self.log_sigma,
            "low": self.box.low,
            "high": self.box.high,
        }
        for number, (weight, bias) in enumerate(self.layers):
            arrays |= {f"{number}.weight": weight, f"{number}.bias": bias}
        tensors.write(path, arrays, {**self.described, "kind": KIND})

    @classmethod
    def load(cls, path: Path) -> Policy:
        """Read `save`'s file; raises NotFoundError, InvalidInputError or DamagedError."""
        arrays, described = tensors.read(path, KIND)
        try:
            policy = cls(
                Standardizer(arrays["shift"], arrays["scale"]),
                tuple(
                    (arrays[f"{n}.weight"], arrays[f"{n}.bias"])
                    for n in range(len(arrays) // 2 - 2)
                ),
                arrays["log_sigma"],
                ActionBox(arrays["low"], arrays["high"]),
                described,
            )
            policy(np.zeros((1, policy.standardiser.width), np.float32))
        except (KeyError, IndexError, ValueError) as error:
            raise DamagedError(f"{path}: expected arrays that fit, found {error}") from None
        return policy
