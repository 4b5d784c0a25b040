"""The settings of a training run: flags of the command, and part of every checkpoint."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any, Literal, get_args

from ssil_data.errors import InvalidInputError
from ssil_data.json_kinds import is_finite, show_short, to_python_number
from ssil_data.kernels import check_alpha

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
        "cloning_weight_decay",
        "pair_reward",
    }
)
_AT_MOST_ONE = frozenset({"discount", "gae_lambda", "fisher_share", "eta_decay"})

Weighting = Literal["sure", "posterior", "ratio"]
"""How unlabeled pairs are weighted: the sure ones alike, by their leverage, or by its odds."""

PAPER: Mapping[str, Any] = MappingProxyType(
    {
        "gae_lambda": 0.0,
        "centered": False,
        "gradient_penalty": 0.0,
        "spectral_norm": False,
        "pair_reward": 0.0,
    }
)
"""The preset `paper`: one-step advantages as in Algorithm 1, and nothing that goes beyond it.

The paper calls α, the sharpness of the kernel, a hyperparameter and never states it. With either
preset LCoR takes the α that the scoring run fitted to the demonstrations, and CoR, a method of its
own with a kernel of other distances, the one that `cor_alpha` fits to them.
"""


@dataclass(frozen=True)
class TrainSettings:
    """Settings of one training run, the same for every method.

    Parameters
    ----------
    seed:
        The same seed on the same machine gives the same policy, byte for byte.
    steps:
        Environment steps in total, rounded up to whole iterations.
    environments:
        Environments stepped side by side.
    horizon:
        Steps that each environment takes per iteration.
    hidden:
        Units in each of the two hidden layers of every network.
    log_sigma:
        Logarithm of the policy's standard deviation at the start, in half-widths of the action box.
    discount:
        γ of the returns, at most 1.
    gae_lambda:
        λ of the advantages, at most 1; 0 is the paper's one-step form.
    kl:
        Bound on the mean KL divergence of one policy step, in nats.
    damping:
        Added to the diagonal of the Fisher matrix.
    conjugate_steps:
        Steps of the conjugate gradient.
    fisher_share:
        Share of the rollout that the Fisher matrix is estimated on.
    entropy:
        λ of the entropy bonus, in standard deviations of the advantage per nat.
    critic_epochs:
        Passes over the rollout that fit the two critics.
    critic_batch:
        States in a batch of the critics.
    critic_rate:
        Step size of the critics.
    discriminator_steps:
        Gradient steps of the discriminator per iteration.
    discriminator_batch:
        Pairs of the policy, and as many expert pairs, in one such step.
    discriminator_rate:
        Step size of the discriminator.
    gradient_penalty:
        Beyond the paper: weight of (‖∇ logit‖ − 1)² between policy pairs and expert pairs.
    spectral_norm:
        Beyond the paper: every layer of the discriminator is 1-Lipschitz.
    eta:
        η at the start, the weight of the state reward (LCoR, CoR).
    eta_decay:
        ε, at most 1: η is multiplied by it when V_D rises more than V_C.
    centered:
        Beyond the paper: the state reward minus its mean over the rollout, so that a constant
        reward gives no survival bonus. η still follows V_C of the reward as the paper has it,
        which a third critic learns.
    cor_alpha:
        α of CoR, for mixgail: `auto`, the one at which CoR of the demonstrations is spread most
        evenly, or a number above 0; the larger, the sharper.
    pair_reward:
        Beyond the paper: weight of the log-odds of the leverage of the pair (s, a) in the state
        reward of ssil and ssil-leverage; 0 is off.
    expert_weighting:
        How methods that imitate by leverage weight unlabeled pairs: `sure` takes those of leverage
        .95 or more, all alike, and no others; `posterior` weights by the leverage w itself; `ratio`
        by its odds w / (1 − w), a density ratio of experts to others. None counts more than a
        labeled pair.
    odds_limit:
        The largest odds of leverage, above 1, in that ratio and in the pair reward: at 20, leverage
        above .952 counts as .952. Leverage is calibrated to some hundredths at best, so larger odds
        would be noise; and without a limit a single pair of leverage 1 would be all that is drawn.
    pretrained:
        Start from a behavior-cloned policy.
    cloning_steps:
        Gradient steps of behavior cloning.
    cloning_batch:
        Pairs in one such step.
    cloning_rate:
        Step size of behavior cloning at its start; it falls to zero as a cosine.
    cloning_weight_decay:
        Decoupled weight decay of the cloned policy, as of AdamW: each step of cloning also shrinks
        weights and biases by step size × this, so at most 1 / `cloning_rate`; 0 is off. It keeps a
        clone of few pairs from fitting their noise. Steps in the environment decay nothing.
    boundary:
        Iterations between checkpoints. The environments are reset at each, so that a resumed run
        goes on exactly as an uninterrupted one.
    evaluate_every:
        Iterations between evaluations of the mean action.
    evaluations:
        Episodes of an evaluation, run side by side.

    Raises
    ------
    InvalidInputError
        For a value of another type, or a number that is out of range.

    Examples
    --------
    >>> TrainSettings(steps=5_000, environments=32, horizon=64).iterations
    3
    >>> TrainSettings(kl=0)
    Traceback (most recent call last):
    ssil_data.errors.InvalidInputError: kl: expected a number above 0, found 0
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
    centered: bool = True
    cor_alpha: Literal["auto"] | float = "auto"
    pair_reward: float = 0.0
    expert_weighting: Weighting = "sure"
    odds_limit: float = 20.0
    pretrained: bool = False
    cloning_steps: int = 2_000
    cloning_batch: int = 256
    cloning_rate: float = 1e-3
    cloning_weight_decay: float = 0.0
    boundary: int = 16
    evaluate_every: int = 5
    evaluations: int = 8

    def __post_init__(self) -> None:
        """Validate every value."""
        for field in fields(self):
            value = to_python_number(getattr(self, field.name))
            object.__setattr__(self, field.name, value)
            required = _find_violated_range(field.name, value, str(field.type))
            if required:
                raise InvalidInputError(
                    f"{field.name}: expected {required}, found {show_short(value)}"
                )
        if self.cloning_rate * self.cloning_weight_decay > 1:
            raise InvalidInputError(
                "cloning_weight_decay: expected at most 1 / cloning_rate, "
                f"{1 / self.cloning_rate:g}, found {self.cloning_weight_decay}"
            )

    @property
    def iterations(self) -> int:
        """Number of iterations that the steps make."""
        return math.ceil(self.steps / (self.environments * self.horizon))


def _find_violated_range(name: str, value: Any, declared: str) -> str:
    """Return which type or range a setting leaves, in words; an empty text for one that fits."""
    if name == "expert_weighting":
        kinds = get_args(Weighting)
        return "" if isinstance(value, str) and value in kinds else f"one of {', '.join(kinds)}"
    if name == "cor_alpha":
        return _find_violated_alpha(value)
    if declared == "bool":
        return "" if isinstance(value, bool) else "true or false"
    number = "a whole number" if declared == "int" else "a number"
    fits = is_finite(value) and (declared != "int" or isinstance(value, int))
    if name == "odds_limit":
        return "" if fits and value > 1 else f"{number} above 1"
    if name == "log_sigma":
        return "" if fits else "a finite number"
    may_be_zero = name in _MAY_BE_ZERO
    if not fits or value < 0 or (value == 0 and not may_be_zero):
        return f"{number} of at least 0" if may_be_zero else f"{number} above 0"
    return "at most 1" if value > 1 and name in _AT_MOST_ONE else ""


def _find_violated_alpha(value: Any) -> str:
    """Return what a sharpness has to be; an empty text for one that is."""
    if isinstance(value, str) and value == "auto":
        return ""
    try:
        check_alpha(float(value) if is_finite(value) else math.nan)
    except InvalidInputError:
        return "auto or a number from 1e-06 to 1e+08"
    return ""
