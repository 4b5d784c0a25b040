"""LCoR's sums in plain torch, block by block: for any processor and any of torch's devices.

The last bits of an answer may depend on how many queries the call has and how many threads torch
uses, because those of torch's matrix products do.
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

BLOCK_QUERIES = 64
BLOCK_STATES = 8192
"""A block of distances on a processor; on an accelerator each side is 8 times as long."""
CHUNK_ROWS = 1 << 20
"""States that are read and copied to the device at a time."""


@dataclass(frozen=True, eq=False)
class Tensors:
    """Centered states (n, d) float32, n ≥ 1, and leverages (n,) float64 on one of torch's devices.

    Distances are computed in float32, sums in float64.
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
        """Copy states to a device; they are read in parts.

        Parameters
        ----------
        states
            States (n, d).
        center
            Subtracted from the states, (d,).
        leverage
            Leverages (n,).
        device
            Name of the device in torch's words, such as "cpu" or "cuda:0".

        Raises
        ------
        InvalidInputError
            If torch cannot use that device.
        """
        count, width = states.shape
        try:
            copied = torch.empty((count, width), dtype=torch.float32, device=device)
        except (AssertionError, RuntimeError) as error:
            reason = str(error).splitlines()[0]
            raise InvalidInputError(f"device: torch cannot use {device!r}: {reason}") from None
        for i in range(0, count, CHUNK_ROWS):
            copied[i : i + CHUNK_ROWS] = _to_tensor(states[i : i + CHUNK_ROWS] - center)
        return cls(copied, _to_tensor(leverage).to(device).double())

    def sums(self, queries: NDArray[np.float32], *, alpha: float, contributors: int = 0) -> Sums:
        """Return the sums of equation 5.

        Parameters
        ----------
        queries
            Centered queries (m, d).
        alpha
            Sharpness of the kernel, > 0.
        contributors
            How many of the heaviest states to name; all, if there are fewer.
        """
        growth = 1 if self.states.device.type == "cpu" else 8
        rows = max(BLOCK_STATES * growth, contributors)
        blocks = [slice(i, i + rows) for i in range(0, len(self.states), rows)]
        cuts = range(BLOCK_QUERIES * growth, len(queries), BLOCK_QUERIES * growth)
        return Sums.join(
            [
                reduce(add, (self._sum_block(part, block, alpha, contributors) for block in blocks))
                for part in np.split(queries, cuts)
            ]
        )

    def _sum_block(
        self, queries: NDArray[np.float32], chosen: slice, alpha: float, contributors: int
    ) -> Sums:
        there = _to_tensor(queries).to(self.states.device)
        distance = torch.cdist(there, self.states[chosen], p=1.0)
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
    """Return the `products` of `SampleMoments`, (15, m): what the compiled code's `MOMENTS` are.

    Parameters
    ----------
    queries
        Centered queries (m, d).
    states
        Centered states (n, d) of the sample.
    leverage
        Their leverages (n,), less the mean.
    distance
        Mean distance d₀ of each query to all references, (m,).
    alpha
        Sharpness of the kernel, > 0.
    """
    powers = _to_tensor(leverage).double()[:, None] ** torch.arange(3)
    columns = []
    for rows in np.array_split(np.arange(len(queries)), -(-len(queries) // BLOCK_QUERIES)):
        found = torch.cdist(_to_tensor(queries[rows]), _to_tensor(states), p=1.0).double()
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
    """Return the sums of equation 5 over states that are needed for this call alone.

    Parameters
    ----------
    queries
        Queries (m, d), standardized.
    states
        States (n, d), n ≥ 1, standardized.
    leverage
        Leverages (n,).
    alpha
        Sharpness of the kernel, > 0.
    contributors
        How many of the heaviest states to name.
    """
    tensors = Tensors.of(states, np.zeros(states.shape[1], np.float32), leverage)
    return tensors.sums(queries, alpha=alpha, contributors=contributors)


def _to_tensor(array: NDArray[np.float32]) -> torch.Tensor:
    """Share the memory of an array where torch can; it warns of arrays it may not write."""
    return torch.from_numpy(np.require(array, requirements=["W", "C"]))
