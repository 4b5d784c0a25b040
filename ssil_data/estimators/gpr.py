"""GPR: a pair is unusual where a Gaussian process of experts' actions is unsure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.estimators.base import (
    Estimator,
    Fitted,
    Uncertainty,
    apply_in_blocks,
    check_equal,
    check_fit_input,
)
from ssil_data.estimators.gaussian_process import Process
from ssil_data.estimators.unlabeled import UnlabeledSample, standardize_pairs
from ssil_data.features import Standardizer


@dataclass(frozen=True)
class GPR(Estimator):
    """Gaussian process regression of the expert's action: uncertain = far from labeled states.

    ARD RBF kernel plus noise, one process per action dimension. The uncertainty is the posterior
    deviation of the action that the process expects; larger = less like the labeled pairs.

    Parameters
    ----------
    learn_on
        Labeled pairs, drawn by the seed, that the kernel is learned from; cost grows as its cube.
    inducing
        The posterior is exact up to so many labeled pairs; of more, so many, drawn by the seed,
        become inducing points.
    steps
        Steps of L-BFGS. Few on purpose: the lengthscales overfit soon.
    noise_floor
        Least noise variance, as a share of the action's variance.
    surprisal
        Judge the action that was taken, −log p(a | s) of the standardized action in nats, which
        may be negative, instead of the deviation. An extension of the paper.

    Raises
    ------
    InvalidInputError
        For a number that is not positive and finite, or not whole where it counts something.

    Source
    ------
    Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, chapters 2 and 5.

    Examples
    --------
    >>> fitted = sd.GPR(learn_on=50, steps=2).fit(dataset.labeled(), seed=0)
    >>> fitted.uncertainty(dataset.pairs()).total.shape == (len(dataset),)
    True
    """

    kind: ClassVar[str] = "gpr"
    learn_on: int = 600
    inducing: int = 2048
    steps: int = 10
    noise_floor: float = 1e-3
    surprisal: bool = False

    def fit(
        self, labeled: Pairs, *, seed: int, unlabeled: UnlabeledSample | None = None
    ) -> FittedGPR:
        """Fit to the labeled pairs, standardized by their own mean and deviation.

        Parameters
        ----------
        labeled
            Expert pairs, two at least.
        seed
            Draws the pairs to learn on and the inducing points. Same seed, same machine, same
            result.
        unlabeled
            A sample of the unlabeled pairs, for the least scale of a dimension; None for none.

        Returns
        -------
        FittedGPR
            The fitted estimator.

        Raises
        ------
        InvalidInputError
            For fewer than two pairs or a seed outside 0 to 2^63 − 1.
        """
        from ssil_data.estimators.learning import marginal, posterior

        check_fit_input(labeled, seed)
        states, actions = standardize_pairs(labeled, unlabeled)
        x = states(labeled.states)
        y = actions(labeled.actions)
        order = np.random.default_rng(seed).permutation(len(x))
        learned = np.sort(order[: self.learn_on])
        inducing = x[np.sort(order[: self.inducing])]
        kernels = marginal.learn(
            x[learned], y[learned], steps=self.steps, noise_floor=self.noise_floor
        )
        targets = zip(kernels, y.T, strict=True)
        return FittedGPR(
            settings=self,
            state_width=x.shape[1],
            action_width=y.shape[1],
            states=states,
            actions=actions,
            inducing=inducing,
            processes=tuple(
                posterior.condition(kernel, inducing, x, target) for kernel, target in targets
            ),
        )


@dataclass(frozen=True, eq=False)
class FittedGPR(Fitted):
    """r = (Σ posterior variance of the action dimensions)^½, without the constant noise.

    Parameters
    ----------
    settings
        What it was fitted with.
    states, actions
        Standardize states (d,) and actions (k,) by the labeled pairs.
    inducing
        The standardized labeled states that the posterior is expressed in, (m, d).
    processes
        One posterior for each of the k action dimensions.
    """

    settings: GPR
    states: Standardizer
    actions: Standardizer
    inducing: NDArray[np.float32]
    processes: tuple[Process, ...]

    def __post_init__(self) -> None:
        """Validate that the parts fit the widths."""
        count, width = self.inducing.shape
        check_equal("states", self.states.width, self.state_width)
        check_equal("actions", self.actions.width, self.action_width)
        check_equal("inducing", width, self.state_width)
        check_equal("processes", len(self.processes), self.action_width)
        for process in self.processes:
            check_equal("lengthscale", process.kernel.lengthscale.shape, (width,))
            check_equal("signal", process.kernel.signal.shape, ())
            check_equal("noise", process.kernel.noise.shape, ())
            check_equal("root", process.root.shape, (count, len(process.coefficients)))
            check_equal("coefficients", process.coefficients.ndim, 1)

    @property
    def noise(self) -> NDArray[np.float32]:
        """Noise variance of each standardized action dimension (k,)."""
        return np.array([process.kernel.noise for process in self.processes])

    def posterior(self, states: NDArray[np.float32]) -> tuple[NDArray, NDArray]:
        """Return what action the process expects in a state, and how sure it is.

        Parameters
        ----------
        states
            Raw states (n, d).

        Returns
        -------
        tuple of ndarray
            Mean (n, k) and variance (n, k) of the standardized action without its noise.
        """
        x = self.states(states)
        moments = [process(x, self.inducing) for process in self.processes]
        mean, variance = (np.column_stack(each) for each in zip(*moments, strict=True))
        return mean, variance

    def _uncertainty(self, pairs: Pairs) -> Uncertainty:
        def judge(states: NDArray[np.float32], actions: NDArray[np.float32]) -> NDArray[np.float32]:
            mean, variance = self.posterior(states)
            deviation = np.sqrt(variance.sum(axis=1))
            if not self.settings.surprisal:
                return np.column_stack([deviation, deviation])
            spread = variance + self.noise
            distance = np.square(self.actions(actions) - mean) / spread
            surprisal = (distance + np.log(2 * np.pi * spread)).sum(axis=1) / 2
            return np.column_stack([surprisal, deviation])

        total, epistemic = apply_in_blocks(judge, pairs.states, pairs.actions).T.copy()
        aleatoric = np.full_like(epistemic, np.sqrt(self.noise.sum()))
        return Uncertainty(total, {"aleatoric": aleatoric, "epistemic": epistemic})
