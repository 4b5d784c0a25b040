"""Learning the kernel of a Gaussian process by its marginal likelihood, with gpytorch."""

from __future__ import annotations

import inspect
import math

import gpytorch
import numpy as np
import torch
from gpytorch.constraints import GreaterThan
from gpytorch.distributions import MultivariateNormal
from gpytorch.kernels import RBFKernel, ScaleKernel
from gpytorch.likelihoods import GaussianLikelihood
from numpy.typing import NDArray
from torch import Tensor

from ssil_data.estimators.gaussian_process import Kernel
from ssil_data.estimators.learning.descent import reproducible


class _LBFGS(torch.optim.LBFGS):
    """Torch's, which would import torch's compiler: a second in a new process, for nothing here."""

    add_param_group = inspect.unwrap(torch.optim.Optimizer.add_param_group)


class _Process(gpytorch.models.ExactGP):
    """One zero-mean process per action dimension under an ARD RBF kernel."""

    def __init__(self, x: Tensor, y: Tensor, likelihood: GaussianLikelihood) -> None:
        super().__init__(x, y, likelihood)
        each = y.shape[:1]
        self.rbf = RBFKernel(ard_num_dims=x.shape[1], batch_shape=each)
        self.rbf.initialize(lengthscale=math.sqrt(x.shape[1]))
        self.kernel = ScaleKernel(self.rbf, batch_shape=each)

    def forward(self, x: Tensor) -> MultivariateNormal:
        covariance = self.kernel(x)
        return MultivariateNormal(x.new_zeros(covariance.shape[:-1]), covariance)


def learn(
    states: NDArray[np.float32], actions: NDArray[np.float32], *, steps: int, noise_floor: float
) -> list[Kernel]:
    """Maximize the marginal likelihood of pairs over the kernels, by L-BFGS.

    Exact, so a step costs n³; in float64, where a Cholesky factor of close neighbors exists.

    Parameters
    ----------
    states, actions
        Standardized pairs, (n, d) and (n, k).
    steps
        Steps of L-BFGS.
    noise_floor
        Least noise variance.

    Returns
    -------
    list of Kernel
        One kernel for each of the k action dimensions.
    """
    x = torch.from_numpy(states).double()
    y = torch.from_numpy(actions).double().T.contiguous()
    floor = GreaterThan(noise_floor)
    likelihood = GaussianLikelihood(noise_constraint=floor, batch_shape=y.shape[:1])
    process = _Process(x, y, likelihood).double()
    evidence = gpytorch.mlls.ExactMarginalLogLikelihood(likelihood, process)
    descent = _LBFGS(process.parameters(), max_iter=steps, line_search_fn="strong_wolfe")

    def loss() -> Tensor:
        process.zero_grad()
        surprisal = -evidence.forward(process(x), y).sum()
        surprisal.backward()
        return surprisal

    with (
        reproducible(seed=0),
        gpytorch.settings.fast_computations(False, False, False),
        gpytorch.settings.max_cholesky_size(len(x) + 1),
    ):
        descent.step(loss)
    columns = (
        process.rbf.lengthscale.squeeze(1),
        process.kernel.outputscale,
        likelihood.noise.squeeze(1),
    )
    arrays = (column.detach().float().numpy() for column in columns)
    return [Kernel(*map(np.asarray, each)) for each in zip(*arrays, strict=True)]
