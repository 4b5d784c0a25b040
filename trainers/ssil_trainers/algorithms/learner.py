"""The adversarial loop of GAIL, MixGAIL and SSIL (Algorithm 1); they differ in what is passed in.

Reward r(s, a) = −log D(s, a) + η · shaping(s), with D → 1 for the policy; each part has its own
critic, V_D and V_C, and its own advantage, A = A_D + η A_C. It takes environments and imports none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ssil_data.features import Standardizer
from ssil_trainers.algorithms.advantage import advantages
from ssil_trainers.algorithms.behavior_cloning import clone
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.discriminator import DiscriminatorUpdate
from ssil_trainers.algorithms.expert_sampler import ExpertSampler
from ssil_trainers.algorithms.networks import Discriminator, PolicyNetwork, TwoCritics
from ssil_trainers.algorithms.policy import Policy
from ssil_trainers.algorithms.rewards import Shaping
from ssil_trainers.algorithms.rollout import Driver, Rollout
from ssil_trainers.algorithms.trpo import TrustRegion


@dataclass(frozen=True)
class Iteration:
    """What one iteration did.

    number: how many were done with it; steps: environment steps in all; eta: η after it; accuracy:
    share of pairs that the discriminator told rightly; kl: of the policy step, 0 if none was taken;
    discriminator_reward, shaping: means over the rollout, before it is centred; sigma: the policy's
    mean deviation; ended: how many episodes ended.
    """

    number: int
    steps: int
    eta: float
    accuracy: float
    kl: float
    discriminator_reward: float
    shaping: float
    sigma: float
    ended: int


class Learner:
    """A policy, two critics and a discriminator, and one iteration of learning.

    Everything random in iteration i is drawn from the seed and i alone, so a learner needs no
    random state: its arrays and the number of iterations done are all there is to keep.
    """

    def __init__(
        self,
        settings: TrainSettings,
        *,
        driver: Driver,
        experts: ExpertSampler,
        shaping: Shaping,
        standardiser: Standardizer,
    ) -> None:
        """Make untrained networks."""
        self.settings, self.driver, self.experts = settings, driver, experts
        self.shaping, self.standardiser = shaping, standardiser
        self.done, self.eta = 0, settings.eta
        self.initial = driver.states
        states, actions, hidden = driver.width, len(driver.box.low), settings.hidden
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(settings.seed)
            self.policy = PolicyNetwork(states, actions, hidden, settings.log_sigma)
            self.critics = TwoCritics(states, hidden, settings.discount)
            self.discriminator = Discriminator(
                states, actions, hidden, spectral=settings.spectral_norm
            )
        self.critic_adam = _adam(self.critics, settings.critic_rate)
        self.discriminator_adam = _adam(self.discriminator, settings.discriminator_rate)

    def clone(self) -> float:
        """Clone the experts' behaviour; return the squared error that is left."""
        to = self.settings
        return clone(
            self.policy,
            self.experts,
            steps=to.cloning_steps,
            batch=to.cloning_batch,
            rate=to.cloning_rate,
            rng=np.random.default_rng([to.seed, 0, 1]),
        )

    def start_anew(self) -> None:
        """Reset the environments to where iteration `done` of this seed starts."""
        seed = np.random.SeedSequence([self.settings.seed, self.done, 2]).generate_state(1)[0]
        self.initial = self.driver.reset(int(seed) % 2**31)

    def iterate(self) -> Iteration:
        """Do one iteration of Algorithm 1, lines 5 to 8."""
        to, rng = self.settings, np.random.default_rng([self.settings.seed, self.done, 3])
        noise = rng.standard_normal((to.horizon, to.environments, len(self.driver.box.low)))
        rollout = self.driver.roll(self.snapshot(), noise.astype(np.float32))
        states, next_states = (
            self._standardize(rollout.states),
            self._standardize(rollout.next_states),
        )
        pairs = torch.cat([states, _rows(rollout.actions)], dim=1)

        teaching = DiscriminatorUpdate(
            to.discriminator_steps, to.discriminator_batch, to.gradient_penalty
        )
        accuracy = teaching(
            self.discriminator, self.discriminator_adam, pairs=pairs, experts=self.experts, rng=rng
        )
        with torch.no_grad():
            discriminator_reward = self.discriminator.reward(pairs).numpy()
            values, next_values = self.critics(states).numpy(), self.critics(next_states).numpy()
        shaping = self.shaping(rollout.states.reshape(-1, self.driver.width))
        paid = shaping - shaping.mean() if to.centred else shaping
        rewards = np.stack([discriminator_reward, paid])
        advantage_d, advantage_c = both = self._advantages(rollout, rewards, values, next_values)

        region = TrustRegion(to.kl, to.damping, to.conjugate_steps, to.fisher_share, to.entropy)
        advantage = _standard(advantage_d + self.eta * advantage_c)
        step = region.step(self.policy, states, _rows(rollout.drawn), advantage)
        rise_d, rise_c = self._fit_critics(states, values + both, rng)
        self.eta = decay_eta(self.eta, to.eta_decay, rise_d=rise_d, rise_c=rise_c)
        self.done += 1
        return Iteration(
            number=self.done,
            steps=self.done * rollout.ended.size,
            eta=self.eta,
            accuracy=accuracy,
            kl=step.kl,
            discriminator_reward=float(discriminator_reward.mean()),
            shaping=float(np.mean(shaping)),
            sigma=float(self.policy.log_sigma.detach().exp().mean()),
            ended=int(rollout.ended.sum()),
        )

    def _advantages(self, rollout: Rollout, *of_rows: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return A_D and A_C (2, T·N) of rewards, values and next values (2, T·N)."""
        horizon, count = rollout.ended.shape
        parts = advantages(
            *(part.reshape(2, horizon, count).swapaxes(0, 1) for part in of_rows),
            terminated=rollout.terminated[:, None],
            ended=rollout.ended[:, None],
            discount=self.settings.discount,
            gae_lambda=self.settings.gae_lambda,
        )
        return parts.swapaxes(0, 1).reshape(2, -1)

    def _fit_critics(
        self, states: Tensor, targets: NDArray[np.floating], rng: np.random.Generator
    ) -> tuple[float, float]:
        """Fit V_D and V_C to targets (2, n); return how much each rose at the initial states."""
        to, initial = self.settings, self._standardize(self.initial)
        wanted = torch.from_numpy(targets.astype(np.float32))
        with torch.no_grad():
            before = self.critics(initial).mean(dim=1)
        for _ in range(to.critic_epochs):
            order = torch.from_numpy(rng.permutation(len(states)))
            for rows in order.split(to.critic_batch):
                away = (self.critics(states[rows]) - wanted[:, rows]) / self.critics.unit
                self.critic_adam.zero_grad()
                away.square().mean(dim=1).sum().backward()
                self.critic_adam.step()
        with torch.no_grad():
            rise_d, rise_c = (self.critics(initial).mean(dim=1) - before).tolist()
        return rise_d, rise_c

    def snapshot(self, described: Mapping[str, Any] | None = None) -> Policy:
        """Return the policy as it is now, as plain arrays."""
        log_sigma = self.policy.log_sigma.detach().numpy().copy()
        layers, box = self.policy.layers(), self.driver.box
        return Policy(self.standardiser, layers, log_sigma, box, described or {})

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything learned, and the optimisers' moments, by dotted names."""
        found: dict[str, NDArray[Any]] = {}
        for name, network in self._networks.items():
            for key, value in network.state_dict().items():
                found[f"{name}.{key}"] = value.numpy().copy()
        for name, optimiser in self._optimisers.items():
            for number, moments in optimiser.state_dict()["state"].items():
                for key, value in moments.items():
                    found[f"{name}.{number}.{key}"] = value.numpy().copy()
        return found

    def restore(self, arrays: Mapping[str, NDArray[Any]], *, done: int, eta: float) -> None:
        """Take `arrays` of a learner of the same settings, after so many iterations, with its η."""
        tensors = {name: torch.from_numpy(np.array(array)) for name, array in arrays.items()}
        for name, network in self._networks.items():
            network.load_state_dict({key: tensors[f"{name}.{key}"] for key in network.state_dict()})
        for name, optimiser in self._optimisers.items():
            state: dict[int, dict[str, Tensor]] = {}
            for path, tensor in tensors.items():
                if path.startswith(f"{name}."):
                    _, number, key = path.split(".")
                    state.setdefault(int(number), {})[key] = tensor
            groups = optimiser.state_dict()["param_groups"]
            optimiser.load_state_dict({"state": state, "param_groups": groups})
        self.done, self.eta = done, eta

    @property
    def _networks(self) -> dict[str, nn.Module]:
        names = ("policy", "critics", "discriminator")
        return {name: getattr(self, name) for name in names}

    @property
    def _optimisers(self) -> dict[str, torch.optim.Optimizer]:
        return {name: getattr(self, name) for name in ("critic_adam", "discriminator_adam")}

    def _standardize(self, states: NDArray[np.float32]) -> Tensor:
        return torch.from_numpy(self.standardiser(states.reshape(-1, self.driver.width)))


def decay_eta(eta: float, decay: float, *, rise_d: float, rise_c: float) -> float:
    """Return ε·η if V_D rose more than V_C at the initial states, η otherwise (Algorithm 1)."""
    return decay * eta if rise_d > rise_c else eta


def _adam(network: nn.Module, rate: float) -> torch.optim.Adam:
    return torch.optim.Adam(network.parameters(), lr=rate, fused=True)


def _rows(steps: NDArray[np.float32]) -> Tensor:
    return torch.from_numpy(steps.reshape(-1, steps.shape[-1]))


def _standard(advantage: NDArray[np.float64]) -> Tensor:
    away = advantage - advantage.mean()
    return torch.from_numpy((away / (away.std() + 1e-8)).astype(np.float32))
