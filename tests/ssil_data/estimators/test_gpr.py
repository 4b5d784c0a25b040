"""The Gaussian process."""

import numpy as np
import pytest
from scipy.linalg import cholesky, qr, solve_triangular
from scipy.stats import norm
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from ssil_data.demonstrations import Pairs
from ssil_data.estimators import GPR
from ssil_data.estimators.gpr import FittedGPR
from ssil_data.estimators.learning.posterior import JITTER


@pytest.fixture(scope="module")
def exact(expert: Pairs) -> FittedGPR:
    """A process conditioned on every labeled pair."""
    return GPR().fit(expert, seed=0)


@pytest.fixture(scope="module")
def sparse(expert: Pairs) -> FittedGPR:
    """The same kernel through 100 inducing points."""
    return GPR(inducing=100).fit(expert, seed=0)


def test_the_posterior_is_scikit_learns_under_the_same_kernel(
    exact: FittedGPR, expert: Pairs, random: Pairs
):
    mean, variance = exact.posterior(random.states)
    for action in range(2):
        kernel = exact.processes[action].kernel
        rbf = RBF(kernel.lengthscale.astype(float))
        peer = GaussianProcessRegressor(
            ConstantKernel(kernel.signal) * rbf, alpha=kernel.noise, optimizer=None
        )
        peer.fit(exact.states(expert.states), exact.actions(expert.actions)[:, action])
        peer_mean, peer_deviation = peer.predict(exact.states(random.states), return_std=True)
        np.testing.assert_allclose(mean[:, action], peer_mean, atol=1e-2)
        np.testing.assert_allclose(np.sqrt(variance[:, action]), peer_deviation, atol=2e-3)


def test_with_inducing_points_the_posterior_is_that_of_a_least_squares_problem(
    sparse: FittedGPR, expert: Pairs, random: Pairs
):
    """w = argmin ‖y − kernel(X, Z) w‖² / noise + wᵀ kernel(Z, Z) w, by QR in float64."""
    mean, variance = sparse.posterior(random.states)
    x = sparse.states(expert.states)
    queries = sparse.states(random.states)
    z = sparse.inducing
    for action in range(2):
        kernel = sparse.processes[action].kernel
        signal, noise = float(kernel.signal), float(kernel.noise)
        rbf = RBF(kernel.lengthscale.astype(float))
        prior = cholesky(signal * (np.asarray(rbf(z)) + JITTER * np.eye(len(z))), lower=True)
        cross = signal * np.asarray(rbf(x, z))
        k = signal * np.asarray(rbf(queries, z))
        both = qr(np.vstack([cross / np.sqrt(noise), prior.T]), mode="r")[0][: len(z)]
        known = solve_triangular(both, k.T, trans="T")
        pull = cross.T @ sparse.actions(expert.actions)[:, action] / noise
        expected = known.T @ solve_triangular(both, pull, trans="T")
        lost = np.square(solve_triangular(prior, k.T, lower=True)).sum(0) - np.square(known).sum(0)
        np.testing.assert_allclose(mean[:, action], expected, atol=3e-2)
        np.testing.assert_allclose(variance[:, action], signal - lost, atol=1e-2, rtol=1e-2)


def test_inducing_points_approach_the_exact_deviation(
    exact: FittedGPR, sparse: FittedGPR, random: Pairs
):
    r, approximate = exact.uncertainty(random).total, sparse.uncertainty(random).total
    assert np.corrcoef(r, approximate)[0, 1] > 0.9


def test_the_deviation_leaves_the_constant_noise_out(exact: FittedGPR, random: Pairs):
    uncertainty = exact.uncertainty(random)
    np.testing.assert_array_equal(uncertainty.total, uncertainty.parts["epistemic"])
    np.testing.assert_allclose(uncertainty.parts["aleatoric"], np.sqrt(exact.noise.sum()))


def test_far_from_every_labeled_state_the_deviation_is_the_signals(exact: FittedGPR, random: Pairs):
    far = Pairs(random.states + 1e4, random.actions, random.episode, random.step)
    expected = np.sqrt(sum(process.kernel.signal for process in exact.processes))
    np.testing.assert_allclose(exact.uncertainty(far).total, expected, rtol=1e-4)


def test_surprisal_is_the_negative_logarithm_of_the_predictive_density(
    expert: Pairs, random: Pairs
):
    fitted = GPR(surprisal=True).fit(expert, seed=0)
    mean, variance = fitted.posterior(random.states)
    deviation = np.sqrt(variance + fitted.noise)
    expected = -norm.logpdf(fitted.actions(random.actions), mean, deviation).sum(axis=1)
    np.testing.assert_allclose(fitted.uncertainty(random).total, expected, rtol=1e-3, atol=1e-3)


def test_a_dimension_that_does_not_matter_gets_a_long_lengthscale():
    rng = np.random.default_rng(0)
    states = rng.normal(size=(200, 2))
    actions = np.sin(3 * states[:, :1])
    pairs = Pairs(states, actions, np.arange(200), np.zeros(200, np.int64))
    matters, does_not = GPR().fit(pairs, seed=0).processes[0].kernel.lengthscale
    assert does_not > 5 * matters
