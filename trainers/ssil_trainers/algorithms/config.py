"""What a training run can be told: the command line, and what a checkpoint keeps of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any

from ssil_data.errors import InvalidInputError

_MAY_BE_ZERO = frozenset(
    {
        "seed",
        "steps",
        "gae_lambda",
        "entropy",
        "discriminator_steps",
        "gradient_penalty",
        "eta",
        "cloning_steps",
    }
)
_AT_MOST_ONE = frozenset({"discount", "gae_lambda", "fisher_share", "eta_decay"})

PAPER: Mapping[str, Any] = MappingProxyType(
    {"gae_lambda": 0.0, "centred": False, "gradient_penalty": 0.0, "spectral_norm": False}
)
"""The preset `paper`: one-step advantages as in Algorithm 1, and nothing beyond it.

The paper calls α a hyperparameter and never states it: the preset leaves it to the run, which fits
it to the demonstrations.
"""


@dataclass(frozen=True)
class TrainSettings:
    """Settings of one training run, whatever the method.

    Parameters
    ----------
    seed:
        Same seed, same machine, same policy, byte for byte.
    steps:
        Environment steps in all, rounded up to whole iterations.
    environments:
        Environments driven side by side.
    horizon:
        Steps that each environment takes per iteration.
    hidden:
        Units in each of the two hidden layers of every network.
    log_sigma:
        Logarithm of the policy's deviation at the start, in half-widths of the action box.
    discount:
        γ of the returns.
    gae_lambda:
        λ of the advantages; 0 is the paper's one-step form.
    kl:
        Bound on the mean KL divergence of one policy step.
    damping:
        Added to the diagonal of the Fisher matrix.
    conjugate_steps:
        Steps of the conjugate gradient.
    fisher_share:
        Share of the rollout that the Fisher matrix is estimated on.
    entropy:
        λ of the entropy bonus, in deviations of the advantage per nat.
    critic_epochs:
        Passes over the rollout that fit the two critics.
    critic_batch:
        States in a batch of the critics.
    critic_rate:
        Step size of the critics.
    discriminator_steps:
        Steps of the discriminator per iteration.
    discriminator_batch:
        Pairs of the policy, and as many of the experts, in one such step.
    discriminator_rate:
        Step size of the discriminator.
    gradient_penalty:
        Beyond the paper: weight of (‖∇ logit‖ − 1)² between pairs of the policy and of the experts.
    spectral_norm:
        Beyond the paper: every layer of the discriminator is 1-Lipschitz.
    eta:
        η at the start, the weight of the shaping.
    eta_decay:
        ε: η shrinks by it when V_D rises more than V_C.
    centred:
        Beyond the paper: the shaping minus its mean over the rollout, so that it pays nobody for
        staying alive.
    pretrained:
        Start from a behaviour-cloned policy.
    cloning_steps:
        Steps of behaviour cloning.
    cloning_batch:
        Pairs in one such step.
    cloning_rate:
        Step size of behaviour cloning at its start; falls to zero as a cosine.
    boundary:
        Iterations between checkpoints. Environments start anew at each, so that a resumed run
        goes on as if it had never stopped.
    evaluate_every:
        Iterations between evaluations of the mean action.
    evaluations:
        Episodes of an evaluation, driven side by side.
    """

    seed: int = 0
    steps: int = 122_880
    environments: int = 32
    horizon: int = 64
    hidden: int = 64
    log_sigma: float = -0.7
    discount: float = 0.99
    gae_lambda: float = 0.97
    kl: float = 0.01
    damping: float = 0.1
    conjugate_steps: int = 10
    fisher_share: float = 0.25
    entropy: float = 0.001
    critic_epochs: int = 5
    critic_batch: int = 256
    critic_rate: float = 1e-3
    discriminator_steps: int = 10
    discriminator_batch: int = 256
    discriminator_rate: float = 5e-4
    gradient_penalty: float = 0.0
    spectral_norm: bool = False
    eta: float = 1.0
    eta_decay: float = 0.99
    centred: bool = True
    pretrained: bool = False
    cloning_steps: int = 2_000
    cloning_batch: int = 256
    cloning_rate: float = 1e-3
    boundary: int = 16
    evaluate_every: int = 5
    evaluations: int = 8

    def __post_init__(self) -> None:
        """Validate every number."""
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "log_sigma":
                wrong = "" if math.isfinite(value) else "a finite number"
            elif not math.isfinite(value) or value < 0:
                wrong = "a number of at least 0"
            elif value == 0 and field.name not in _MAY_BE_ZERO and field.type != "bool":
                wrong = "a number above 0"
            else:
                wrong = "at most 1" if value > 1 and field.name in _AT_MOST_ONE else ""
            if wrong:
                raise InvalidInputError(f"{field.name}: expected {wrong}, found {value}")

    @property
    def iterations(self) -> int:
        """How many iterations the steps make."""
        return math.ceil(self.steps / (self.environments * self.horizon))
