"""LCoR's sums in plain torch, block by block: the engine for any host and any device of torch's.

The last bits of an answer may change with the number of queries asked at once and of torch's
threads: so do its matrix products.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np
import torch
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.kernels.rows import Rows
from ssil_data.kernels.sums import Sums

_QUERIES, _STATES = 64, 8192
"""Distances that a block holds on a processor; an accelerator gets 64 times as many."""
_AT_ONCE = 1 << 20


@dataclass(frozen=True, eq=False)
class Tensors:
    """Centered states (n, d), n ≥ 1, and leverage (n,) on a device.

    Distances are float32, sums float64.
    """

    states: torch.Tensor
    leverage: torch.Tensor

    @classmethod
    def of(
        cls,
        states: Rows,
        center: NDArray[np.float32],
        leverage: NDArray[np.float32],
        device: str = "cpu",
    ) -> Tensors:
        """Bring states (n, d), minus `center` (d,), to a device; they are read in parts.

        Raises InvalidInputError for a device that torch cannot use.
        """
        count, width = states.shape
        try:
            held = torch.empty((count, width), dtype=torch.float32, device=device)
        except (AssertionError, RuntimeError) as error:
            reason = str(error).splitlines()[0]
            raise InvalidInputError(
                f"device: expected one that torch can use, found {device!r}: {reason}"
            ) from None
        for i in range(0, count, _AT_ONCE):
            held[i : i + _AT_ONCE] = _tensor(states[i : i + _AT_ONCE] - center)
        return cls(held, _tensor(leverage).to(device).double())

    def sums(self, queries: NDArray[np.float32], *, alpha: float, contributors: int = 0) -> Sums:
        """Return the sums of equation 5 for centered queries (m, d).

        With fewer states than contributors, all states contribute.
        """
        growth = 1 if self.states.device.type == "cpu" else 8
        block = max(_STATES * growth, contributors)
        columns = [
            reduce(
                add,
                (
                    self._block(part, slice(i, i + block), alpha, contributors)
                    for i in range(0, len(self.states), block)
                ),
            )
            for part in np.split(queries, range(_QUERIES * growth, len(queries), _QUERIES * growth))
        ]
        return Sums.join(columns)

    def _block(
        self, queries: NDArray[np.float32], chosen: slice, alpha: float, contributors: int
    ) -> Sums:
        asked = _tensor(queries).to(self.states.device)
        distance = torch.cdist(asked, self.states[chosen], p=1.0)
        log_kernel = torch.log1p(distance.double() / alpha) * (-(alpha + 1) / 2)
        log_scale = log_kernel.max(dim=1).values
        weights = torch.exp(log_kernel - log_scale[:, None])
        top = torch.topk(weights, min(contributors, weights.shape[1]), dim=1)
        return Sums(
            numerator=(weights @ self.leverage[chosen]).cpu().numpy(),
            denominator=weights.sum(dim=1).cpu().numpy(),
            squares=(weights * weights).sum(dim=1).cpu().numpy(),
            log_scale=log_scale.cpu().numpy(),
            nearest=top.indices.cpu().numpy() + chosen.start,
            nearest_weight=top.values.cpu().numpy(),
        )


def moments(
    queries: NDArray[np.float32],
    states: NDArray[np.float32],
    leverage: NDArray[np.float32],
    distance: NDArray[np.float64],
    *,
    alpha: float,
) -> NDArray[np.float64]:
    """Return `SampleMoments.products` (15, m) of states (n, d) about queries (m, d)."""
    powers = _tensor(leverage).double()[:, None] ** torch.arange(3)
    columns = []
    for rows in np.array_split(np.arange(len(queries)), -(-len(queries) // _QUERIES)):
        found = torch.cdist(_tensor(queries[rows]), _tensor(states), p=1.0).double()
        start = torch.from_numpy(distance[rows, None])
        u = (found - start) / (alpha + start)
        w = torch.exp(torch.log1p(u) * (-(alpha + 1) / 2))
        products = torch.stack([u, u * u, w, w * u, w * w]) @ powers
        columns.append(products.permute(0, 2, 1).reshape(15, -1).numpy())
    return np.concatenate(columns, axis=1)


def lcor_sums(
    queries: NDArray[np.float32],
    states: NDArray[np.float32],
    leverage: NDArray[np.float32],
    *,
    alpha: float,
    contributors: int = 0,
) -> Sums:
    """Return the sums of equation 5 for queries (m, d) over states (n, d), n ≥ 1, brought for once.

    States and queries are standardized already; leverage is (n,).
    """
    held = Tensors.of(states, np.zeros(states.shape[1], np.float32), leverage)
    return held.sums(queries, alpha=alpha, contributors=contributors)


def _tensor(array: NDArray[np.float32]) -> torch.Tensor:
    return torch.from_numpy(np.require(array, requirements=["W", "C"]))
