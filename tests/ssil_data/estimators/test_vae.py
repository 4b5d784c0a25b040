"""The autoencoders."""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from ssil_data.demonstrations import Pairs
from ssil_data.estimators import VAE, Estimator, Fitted, WindowVAE
from ssil_data.estimators.learning.descent import network, perceptron
from ssil_data.estimators.vae import FittedAutoencoder

Fit = Callable[[Estimator], Fitted]
both = pytest.mark.parametrize("estimator", [VAE(), WindowVAE()], ids=["vae", "windowvae"])


def test_a_perceptron_answers_as_the_network_it_was_learned_by():
    torch.manual_seed(0)
    learned = network(5, 7, 3)
    x = torch.randn(11, 5)
    np.testing.assert_allclose(perceptron(learned)(x.numpy()), learned(x).detach(), atol=1e-6)


def test_uncertainty_is_the_distance_to_the_rebuilt_state(fit: Fit, random: Pairs):
    fitted = fit(VAE())
    assert isinstance(fitted, FittedAutoencoder)
    standard = (random.states - fitted.standardizer.shift) / fitted.standardizer.scale
    mean = fitted.encoder(standard)[:, : fitted.settings.latent]
    distance = np.linalg.norm(standard - fitted.decoder(mean), axis=1)
    np.testing.assert_allclose(fitted.uncertainty(random).total, distance, rtol=1e-4)


@both
def test_shares_are_positive_and_sum_to_one(estimator: Estimator, fit: Fit, random: Pairs):
    shares = fit(estimator).shares(random)
    assert shares is not None and shares.shape == random.states.shape
    assert (shares >= 0).all()
    np.testing.assert_allclose(shares.sum(axis=1), 1, rtol=1e-5)


@both
def test_the_dimension_that_was_spoiled_has_the_largest_share(
    estimator: Estimator, fit: Fit, other_expert: Pairs
):
    states = other_expert.states.copy()
    states[:, 4] += 20
    spoiled = Pairs(states, other_expert.actions, other_expert.episode, other_expert.step)
    shares = fit(estimator).shares(spoiled)
    assert shares is not None
    assert (shares.argmax(axis=1) == 4).mean() > 0.95


def test_only_windows_need_a_margin(fit: Fit):
    assert fit(VAE()).margin == 0
    assert fit(WindowVAE()).margin == 1


def test_a_window_notices_a_jump_between_familiar_states(fit: Fit, other_expert: Pairs):
    order = np.random.default_rng(0).permutation(len(other_expert))
    jumping = Pairs(
        other_expert.states[order],
        other_expert.actions,
        np.zeros(len(order), np.int64),
        np.arange(len(order)),
    )
    window, single = fit(WindowVAE()), fit(VAE())
    calm = window.uncertainty(other_expert).total.mean()
    assert window.uncertainty(jumping).total.mean() > 2 * calm
    np.testing.assert_allclose(
        np.sort(single.uncertainty(jumping).total),
        np.sort(single.uncertainty(other_expert).total),
        rtol=1e-4,
    )


def test_too_much_beta_silences_every_latent_dimension(expert: Pairs):
    fitted = VAE(beta=100.0).fit(expert, seed=0)
    rebuilt = fitted.decoder(fitted.encoder(fitted.standardizer(expert.states))[:, :8])
    assert rebuilt.std(axis=0).max() < 0.05
