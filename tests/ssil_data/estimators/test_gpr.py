"""The Gaussian process."""

import numpy as np
import pytest
from scipy.stats import norm
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from ssil_data.demonstrations import Pairs
from ssil_data.estimators import GPR
from ssil_data.estimators.gpr import NEGLIGIBLE, FittedGPR


@pytest.fixture(scope="module")
def exact(expert: Pairs) -> FittedGPR:
    """A process conditioned on every labeled pair."""
    return GPR().fit(expert, seed=0)


@pytest.fixture(scope="module")
def sparse(expert: Pairs) -> FittedGPR:
    """The same kernel through 50 inducing points."""
    return GPR(inducing=50).fit(expert, seed=0)


def test_the_posterior_is_scikit_learns_under_the_same_kernel(
    exact: FittedGPR, expert: Pairs, random: Pairs
):
    mean, variance = exact.posterior(random.states)
    for action in range(2):
        kernel = exact.kernel
        rbf = RBF(kernel.lengthscale[action].astype(float))
        peer = GaussianProcessRegressor(
            ConstantKernel(kernel.signal[action]) * rbf, alpha=kernel.noise[action], optimizer=None
        )
        peer.fit(exact.states(expert.states), exact.actions(expert.actions)[:, action])
        peer_mean, peer_deviation = peer.predict(exact.states(random.states), return_std=True)
        np.testing.assert_allclose(mean[:, action], peer_mean, atol=1e-2)
        np.testing.assert_allclose(np.sqrt(variance[:, action]), peer_deviation, atol=2e-3)


def test_the_posterior_is_the_textbooks_in_float64(sparse: FittedGPR, expert: Pairs, random: Pairs):
    kernel, jitter = sparse.kernel, NEGLIGIBLE * np.eye(50)
    x, asked, z = sparse.states(expert.states), sparse.states(random.states), sparse.inducing
    mean, variance = sparse.posterior(random.states)
    for action in range(2):
        signal, noise = float(kernel.signal[action]), float(kernel.noise[action])
        rbf = ConstantKernel(signal) * RBF(kernel.lengthscale[action].astype(float))
        prior, cross, k = (np.asarray(rbf(*pair)) for pair in ((z,), (z, x), (asked, z)))
        prior = prior + signal * jitter
        posterior = np.linalg.inv(prior + cross @ cross.T / noise)
        expected = k @ posterior @ cross @ sparse.actions(expert.actions)[:, action] / noise
        lost = np.einsum("ij,jk,ik->i", k, np.linalg.inv(prior) - posterior, k)
        np.testing.assert_allclose(mean[:, action], expected, atol=1e-2)
        np.testing.assert_allclose(variance[:, action], signal - lost, atol=1e-2, rtol=1e-2)


def test_inducing_points_approach_the_exact_deviation(
    exact: FittedGPR, sparse: FittedGPR, random: Pairs
):
    r, approximate = exact.uncertainty(random).total, sparse.uncertainty(random).total
    assert np.corrcoef(r, approximate)[0, 1] > 0.9


def test_the_deviation_leaves_the_constant_noise_out(exact: FittedGPR, random: Pairs):
    uncertainty = exact.uncertainty(random)
    np.testing.assert_array_equal(uncertainty.total, uncertainty.parts["epistemic"])
    np.testing.assert_allclose(uncertainty.parts["aleatoric"], np.sqrt(exact.kernel.noise.sum()))


def test_far_from_every_labeled_state_the_deviation_is_the_signals(exact: FittedGPR, random: Pairs):
    far = Pairs(random.states + 1e4, random.actions, random.episode, random.step)
    expected = np.sqrt(exact.kernel.signal.sum())
    np.testing.assert_allclose(exact.uncertainty(far).total, expected, rtol=1e-4)


def test_surprisal_is_the_negative_logarithm_of_the_predictive_density(
    expert: Pairs, random: Pairs
):
    fitted = GPR(surprisal=True).fit(expert, seed=0)
    mean, variance = fitted.posterior(random.states)
    deviation = np.sqrt(variance + fitted.kernel.noise)
    expected = -norm.logpdf(fitted.actions(random.actions), mean, deviation).sum(axis=1)
    np.testing.assert_allclose(fitted.uncertainty(random).total, expected, rtol=1e-3, atol=1e-3)


def test_a_dimension_that_does_not_matter_gets_a_long_lengthscale():
    rng = np.random.default_rng(0)
    states = rng.normal(size=(200, 2))
    actions = np.sin(3 * states[:, :1])
    pairs = Pairs(states, actions, np.arange(200), np.zeros(200, np.int64))
    matters, does_not = GPR().fit(pairs, seed=0).kernel.lengthscale[0]
    assert does_not > 5 * matters
