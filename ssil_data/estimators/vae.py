"""VAE and windowVAE: a state is strange where an autoencoder of expert states cannot rebuild it."""

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
    expect,
    refuse_unfit,
)
from ssil_data.estimators.perceptron import Perceptron
from ssil_data.features import Standardizer, windows


@dataclass(frozen=True)
class AutoencoderSettings(Estimator):
    """What VAE and windowVAE have in common; they differ in the steps they see at once.

    `latent` is a ceiling: dimensions that tell less than they cost, weighed by `beta`, fall silent.
    With `beta` 1 the loss is the plain evidence lower bound. `hidden` is the width of the one
    hidden layer on either side; `steps` of Adam see `batch` rows each, at a `rate` falling to 0.
    """

    window: ClassVar[int]
    latent: int = 8
    hidden: int = 64
    beta: float = 1.0
    steps: int = 1000
    batch: int = 256
    rate: float = 1e-2

    def fit(self, labeled: Pairs, *, seed: int) -> FittedAutoencoder:
        """Fit to the labeled states, standardised by their own mean and deviation."""
        from ssil_data.estimators.learning import autoencoder

        refuse_unfit(labeled, seed)
        inputs = autoencoder_inputs(labeled, self.window)
        standardiser = Standardizer.of(inputs)
        encoder, decoder = autoencoder.learn(standardiser(inputs), self, seed=seed)
        return FittedAutoencoder(
            settings=self,
            state_width=labeled.states.shape[1],
            action_width=labeled.actions.shape[1],
            standardiser=standardiser,
            encoder=encoder,
            decoder=decoder,
        )


@dataclass(frozen=True)
class VAE(AutoencoderSettings):
    """Variational autoencoder of single states."""

    kind: ClassVar[str] = "vae"
    window: ClassVar[int] = 1


@dataclass(frozen=True)
class WindowVAE(AutoencoderSettings):
    """The same on two-step windows [s_t, s_{t+1}], which show how the state moves."""

    kind: ClassVar[str] = "windowvae"
    window: ClassVar[int] = 2


@dataclass(frozen=True, eq=False)
class FittedAutoencoder(Fitted):
    """r = ‖s − decoder(encoder mean(s))‖₂ on standardised states or windows (paper)."""

    settings: AutoencoderSettings
    standardiser: Standardizer
    encoder: Perceptron
    decoder: Perceptron

    def __post_init__(self) -> None:
        """Validate that the parts fit the settings and the widths."""
        width, latent = self.settings.window * self.state_width, self.settings.latent
        expect("standardiser", self.standardiser.width, width)
        expect("encoder", self.encoder.widths, (width, 2 * latent))
        expect("decoder", self.decoder.widths, (latent, width))

    @property
    def margin(self) -> int:
        """A window looks one row ahead, and at an episode's end one row back."""
        return self.settings.window - 1

    def _uncertainty(self, pairs: Pairs) -> Uncertainty:
        def error(x: NDArray[np.float32]) -> NDArray[np.float32]:
            squares = self._squared_errors(x)
            return np.sqrt(squares.sum(axis=1))

        return Uncertainty(
            apply_in_blocks(error, autoencoder_inputs(pairs, self.settings.window)), {}
        )

    def shares(self, pairs: Pairs) -> NDArray[np.float32]:
        """Return each state dimension's share of the squared error (n, d), of both steps together.

        Where the error is zero, the shares are equal.
        """
        self.refuse_other_widths(pairs)
        window = self.settings.window
        squares = apply_in_blocks(self._squared_errors, autoencoder_inputs(pairs, window))
        squares = squares.reshape(len(pairs), window, self.state_width).sum(axis=1)
        total = squares.sum(axis=1, keepdims=True)
        even = np.full_like(squares, 1 / self.state_width)
        return np.divide(squares, total, out=even, where=total > 0)

    def _squared_errors(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        standard = self.standardiser(x)
        mean = self.encoder(standard)[:, : self.settings.latent]
        standard -= self.decoder(mean)
        return np.square(standard, out=standard)


def autoencoder_inputs(pairs: Pairs, window: int) -> NDArray[np.float32]:
    """Return what an autoencoder of `window` steps sees of each pair: (n, window · d)."""
    return pairs.states if window == 1 else windows(pairs.states, pairs.episode)
