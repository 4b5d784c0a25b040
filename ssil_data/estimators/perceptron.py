"""A multi-layer perceptron as plain arrays: torch learns it, NumPy evaluates it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError


@dataclass(frozen=True, eq=False)
class Perceptron:
    """One hidden layer, y = tanh(x·inner + inner_bias)·outer + outer_bias.

    Parameters
    ----------
    inner, inner_bias
        From input to hidden layer, (in, hidden) and (hidden,) float32.
    outer, outer_bias
        From hidden layer to output, (hidden, out) and (out,) float32.

    Raises
    ------
    InvalidInputError
        For shapes that do not fit each other.
    """

    inner: NDArray[np.float32]
    inner_bias: NDArray[np.float32]
    outer: NDArray[np.float32]
    outer_bias: NDArray[np.float32]

    def __post_init__(self) -> None:
        """Validate that the layers fit each other."""
        shapes = [array.shape for array in (self.inner, self.inner_bias, self.outer)]
        hidden = self.inner_bias.size
        width = self.outer_bias.size
        expected = [(self.inner.shape[0], hidden), (hidden,), (hidden, width)]
        if shapes != expected or self.outer_bias.ndim != 1:
            raise InvalidInputError(f"perceptron: expected shapes {expected}, found {shapes}")

    @property
    def widths(self) -> tuple[int, int]:
        """The widths of the input and of the output."""
        return self.inner.shape[0], self.outer.shape[1]

    def __call__(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """Evaluate the network.

        Parameters
        ----------
        x
            Inputs (n, in).

        Returns
        -------
        ndarray
            Outputs (n, out).
        """
        hidden = x @ self.inner
        hidden += self.inner_bias
        y = np.tanh(hidden, out=hidden) @ self.outer
        y += self.outer_bias
        return y
