"""VAE and windowVAE: a state is unusual where an autoencoder of expert states cannot rebuild it.

r = ‖s − decoder(encoder mean(s))‖₂ on standardized states, or on two-step windows (paper).
"""

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
from ssil_data.estimators.perceptron import Perceptron
from ssil_data.estimators.unlabeled import UnlabeledSample
from ssil_data.features import Standardizer, windows


@dataclass(frozen=True)
class AutoencoderSettings(Estimator):
    """What VAE and windowVAE share; they differ in how many steps they see at once.

    Parameters
    ----------
    latent
        Latent dimensions at most: unused ones collapse to the prior.
    hidden
        Width of the one hidden layer of encoder and decoder.
    beta
        Weight of the KL term; with 1 the loss is the plain evidence lower bound.
    steps
        Steps of Adam, at a rate that falls to zero.
    batch
        Labeled pairs drawn for each step.
    rate
        Learning rate of the first step.
    """

    window: ClassVar[int]
    latent: int = 8
    hidden: int = 64
    beta: float = 1.0
    steps: int = 1000
    batch: int = 256
    rate: float = 1e-2

    def fit(
        self, labeled: Pairs, *, seed: int, unlabeled: UnlabeledSample | None = None
    ) -> FittedAutoencoder:
        """Fit to the labeled states, standardized by their own mean and deviation.

        Parameters
        ----------
        labeled
            Expert pairs, two at least; only their states are used.
        seed
            Sets the first weights and draws the batches. Same seed, same machine, same result.
        unlabeled
            A sample of the unlabeled pairs, for the least scale of a dimension; None for none.

        Returns
        -------
        FittedAutoencoder
            The fitted estimator.

        Raises
        ------
        InvalidInputError
            For fewer than two pairs or a seed outside 0 to 2^63 − 1.
        """
        from ssil_data.estimators.learning import autoencoder

        check_fit_input(labeled, seed)
        inputs = autoencoder_inputs(labeled, self.window)
        least = None if unlabeled is None else np.tile(unlabeled.least_state_scale, self.window)
        standardizer = Standardizer.of(inputs, least=least)
        encoder, decoder = autoencoder.learn(
            standardizer(inputs),
            latent=self.latent,
            hidden=self.hidden,
            beta=self.beta,
            steps=self.steps,
            batch=self.batch,
            rate=self.rate,
            seed=seed,
        )
        return FittedAutoencoder(
            settings=self,
            state_width=labeled.states.shape[1],
            action_width=labeled.actions.shape[1],
            standardizer=standardizer,
            encoder=encoder,
            decoder=decoder,
        )


@dataclass(frozen=True)
class VAE(AutoencoderSettings):
    """Variational autoencoder of single states: uncertain = it cannot rebuild the state.

    The uncertainty is the distance between a standardized state and what the autoencoder makes of
    it; larger = less like the labeled states.

    Parameters
    ----------
    latent
        Latent dimensions at most: unused ones collapse to the prior.
    hidden
        Width of the one hidden layer of encoder and decoder.
    beta
        Weight of the KL term; with 1 the loss is the plain evidence lower bound.
    steps
        Steps of Adam, at a rate that falls to zero.
    batch
        Labeled pairs drawn for each step.
    rate
        Learning rate of the first step.

    Raises
    ------
    InvalidInputError
        For a number that is not positive and finite, or not whole where it counts something.

    Source
    ------
    Kingma and Welling, Auto-Encoding Variational Bayes, 2014; beta: Higgins et al., 2017.

    Examples
    --------
    >>> fitted = sd.VAE(latent=2, steps=20).fit(dataset.labeled(), seed=0)
    >>> uncertainty = fitted.uncertainty(dataset.pairs()).total
    >>> tier = dataset.per_pair("tier")
    >>> bool(uncertainty[tier == "0-25"].mean() > uncertainty[tier == "expert"].mean())
    True
    """

    kind: ClassVar[str] = "vae"
    window: ClassVar[int] = 1


@dataclass(frozen=True)
class WindowVAE(AutoencoderSettings):
    """Variational autoencoder of two-step windows [s_t, s_{t+1}], which show how the state moves.

    The uncertainty is the distance between a standardized window and what the autoencoder makes of
    it; larger = less like how labeled states follow each other.

    Parameters
    ----------
    latent
        Latent dimensions at most: unused ones collapse to the prior.
    hidden
        Width of the one hidden layer of encoder and decoder.
    beta
        Weight of the KL term; with 1 the loss is the plain evidence lower bound.
    steps
        Steps of Adam, at a rate that falls to zero.
    batch
        Labeled pairs drawn for each step.
    rate
        Learning rate of the first step.

    Raises
    ------
    InvalidInputError
        For a number that is not positive and finite, or not whole where it counts something.

    Examples
    --------
    >>> fitted = sd.WindowVAE(latent=2, steps=20).fit(dataset.labeled(), seed=0)
    >>> fitted.uncertainty(dataset.pairs()).total.shape == (len(dataset),)
    True
    """

    kind: ClassVar[str] = "windowvae"
    window: ClassVar[int] = 2


@dataclass(frozen=True, eq=False)
class FittedAutoencoder(Fitted):
    """r = ‖s − decoder(encoder mean(s))‖₂ on standardized states or windows (paper).

    Parameters
    ----------
    settings
        What it was fitted with.
    standardizer
        Standardizes states or windows by the labeled ones, (window · d,).
    encoder
        Standardized input → means (latent) and log variances (latent).
    decoder
        Latent values → standardized input.
    """

    settings: AutoencoderSettings
    standardizer: Standardizer
    encoder: Perceptron
    decoder: Perceptron

    def __post_init__(self) -> None:
        """Validate that the parts fit the settings and the widths."""
        width = self.settings.window * self.state_width
        latent = self.settings.latent
        check_equal("standardizer", self.standardizer.width, width)
        check_equal("encoder", self.encoder.widths, (width, 2 * latent))
        check_equal("decoder", self.decoder.widths, (latent, width))

    @property
    def margin(self) -> int:
        """A window looks one row ahead, and at an episode's end one row back."""
        return self.settings.window - 1

    def _uncertainty(self, pairs: Pairs) -> Uncertainty:
        def error(x: NDArray[np.float32]) -> NDArray[np.float32]:
            squares = self._squared_errors(x)
            return np.sqrt(squares.sum(axis=1))

        inputs = autoencoder_inputs(pairs, self.settings.window)
        return Uncertainty(apply_in_blocks(error, inputs), {})

    def shares(self, pairs: Pairs) -> NDArray[np.float32]:
        """Return each state dimension's share of the squared error, both steps together.

        Parameters
        ----------
        pairs
            n pairs of the fitted widths.

        Returns
        -------
        ndarray
            The shares (n, d), rows sum to 1; larger = more to blame. All are equal where the error
            is zero.

        Raises
        ------
        InvalidInputError
            For states or actions of another width.
        """
        self.check_widths(pairs)
        window = self.settings.window
        squares = apply_in_blocks(self._squared_errors, autoencoder_inputs(pairs, window))
        squares = squares.reshape(len(pairs), window, self.state_width).sum(axis=1)
        total = squares.sum(axis=1, keepdims=True)
        even = np.full_like(squares, 1 / self.state_width)
        return np.divide(squares, total, out=even, where=total > 0)

    def _squared_errors(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        standard = self.standardizer(x)
        mean = self.encoder(standard)[:, : self.settings.latent]
        standard -= self.decoder(mean)
        return np.square(standard, out=standard)


def autoencoder_inputs(pairs: Pairs, window: int) -> NDArray[np.float32]:
    """Return what an autoencoder is given of each pair.

    Parameters
    ----------
    pairs
        n pairs.
    window
        1 for states, 2 for windows of two steps.

    Returns
    -------
    ndarray
        States or windows, (n, window · d).
    """
    return pairs.states if window == 1 else windows(pairs.states, pairs.episode)
