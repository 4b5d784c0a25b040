"""The adversarial loop of GAIL, MixGAIL and SSIL (Algorithm 1); they differ in what is passed in.

The reward is r(s, a) = −log D(s, a) + η · shaping(s), with D → 1 for the policy. Each part has its
own critic, V_D and V_C, and its own advantage: A = A_D + η A_C. Where the shaping is centered, a
third critic learns its value before centering, for the rule of η alone. The loop is given
environments and imports none.
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
from ssil_trainers.algorithms.advantage import compute_advantages
from ssil_trainers.algorithms.behavior_cloning import clone
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.discriminator import DiscriminatorUpdate
from ssil_trainers.algorithms.eta_decay import decay_eta
from ssil_trainers.algorithms.expert_sampler import PairSampler
from ssil_trainers.algorithms.learner_state import collect_arrays, restore_arrays
from ssil_trainers.algorithms.networks import Critics, Discriminator, PolicyNetwork
from ssil_trainers.algorithms.pair_rewards import PairReward, reward_pairs
from ssil_trainers.algorithms.policy import Policy
from ssil_trainers.algorithms.rewards import Shaping, zero_reward
from ssil_trainers.algorithms.rollout import Rollout, RolloutCollector
from ssil_trainers.algorithms.trpo import TrustRegion


@dataclass(frozen=True)
class Iteration:
    """The figures of one iteration.

    Parameters
    ----------
    number:
        How many iterations are done, this one included.
    steps:
        Environment steps so far.
    eta:
        η after the iteration, the weight of the state reward.
    accuracy:
        Share of pairs that the discriminator classified correctly; ½ means that it cannot separate
        the policy from the experts.
    kl:
        Mean KL divergence of the policy step in nats, 0 if no step was taken.
    discriminator_reward:
        Mean of −log D over the rollout; higher means more expert-like.
    shaping:
        Mean of the state reward over the rollout, before it is centered.
    sigma:
        The policy's mean standard deviation, in half-widths of the action box.
    ended:
        How many episodes ended.
    log_odds:
        Mean log-odds of the leverage of the pairs visited, before they are centered; 0 without a
        pair reward.
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
    log_odds: float = 0.0


class Learner:
    """A policy, two critics and a discriminator, and one iteration of learning.

    Everything random in iteration i is drawn from the seed and i alone. A learner therefore has no
    random state: its arrays, η and the number of iterations done are all that a checkpoint needs.

    Parameters
    ----------
    settings:
        Settings of the run, with the method's own.
    collector:
        The environments to train in.
    experts:
        The expert pairs.
    shaping:
        The state reward, added with weight η.
    standardizer:
        Standardization of states for all networks.
    pair_reward:
        The part of the state reward that sees the action; None for none.

    Examples
    --------
    >>> import gymnasium
    >>> from ssil_trainers.algorithms.expert_sampler import ExpertSampler
    >>> from ssil_trainers.algorithms.rewards import zero_reward
    >>> mode = gymnasium.vector.AutoresetMode.SAME_STEP
    >>> envs = gymnasium.make_vec("Pendulum-v1", 2, vector_kwargs={"autoreset_mode": mode})
    >>> states = np.random.default_rng(0).normal(size=(40, 3)).astype(np.float32)
    >>> learner = Learner(
    ...     TrainSettings(environments=2, horizon=16, hidden=8),
    ...     collector=RolloutCollector(envs),
    ...     experts=ExpertSampler(states, states[:, :1].clip(-1, 1), np.ones(40, np.float32)),
    ...     shaping=zero_reward,
    ...     standardizer=Standardizer.of(states),
    ... )
    >>> learner.reset_environments()
    >>> iteration = learner.iterate()
    >>> iteration.number, iteration.steps, iteration.shaping
    (1, 32, 0.0)
    >>> learner.snapshot()(states).shape
    (40, 1)
    """

    def __init__(
        self,
        settings: TrainSettings,
        *,
        collector: RolloutCollector,
        experts: PairSampler,
        shaping: Shaping,
        standardizer: Standardizer,
        pair_reward: PairReward | None = None,
    ) -> None:
        """Initialize the networks from the seed."""
        self.settings = settings
        self.collector = collector
        self.experts = experts
        self.shaping = shaping
        self.standardizer = standardizer
        self.pair_reward = pair_reward
        self.done = 0
        self.eta = settings.eta
        self.initial = collector.states
        self.discriminator_update = DiscriminatorUpdate(
            settings.discriminator_steps, settings.discriminator_batch, settings.gradient_penalty
        )
        self.trust_region = TrustRegion(
            kl=settings.kl,
            damping=settings.damping,
            conjugate_steps=settings.conjugate_steps,
            fisher_share=settings.fisher_share,
            entropy=settings.entropy,
        )
        states = collector.state_width
        actions = len(collector.action_box.low)
        hidden = settings.hidden
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(settings.seed)
            self.policy = PolicyNetwork(states, actions, hidden, settings.log_sigma)
            self.critics = Critics(
                states,
                hidden,
                settings.discount,
                uncentered=settings.centered and shaping is not zero_reward,
            )
            self.discriminator = Discriminator(
                states, actions, hidden, spectral=settings.spectral_norm
            )
        self.critic_adam = _make_adam(self.critics, settings.critic_rate)
        self.discriminator_adam = _make_adam(self.discriminator, settings.discriminator_rate)

    def clone(self) -> float:
        """Train the policy by behavior cloning; return the squared error that is left."""
        settings = self.settings
        return clone(
            self.policy,
            self.experts,
            steps=settings.cloning_steps,
            batch=settings.cloning_batch,
            rate=settings.cloning_rate,
            weight_decay=settings.cloning_weight_decay,
            rng=np.random.default_rng([settings.seed, 0, 1]),
        )

    def reset_environments(self) -> None:
        """Reset the environments to the states in which this seed's next iteration starts."""
        seed = np.random.SeedSequence([self.settings.seed, self.done, 2]).generate_state(1)[0]
        self.initial = self.collector.reset(int(seed) % 2**31)

    def iterate(self) -> Iteration:
        """Do one iteration of Algorithm 1, lines 5 to 8; return its figures."""
        settings = self.settings
        rng = np.random.default_rng([settings.seed, self.done, 3])

        # Line 5: "Sample demonstrations τ_i ~ π_θi."
        rollout = self._sample_rollout(rng)
        states = self.standardize(rollout.states)
        next_states = self.standardize(rollout.next_states)
        pairs = torch.cat([states, _flatten_steps(rollout.actions)], dim=1)

        # Line 6: "Update the discriminator with the gradient E_π[∇ log D] + E_E[∇ log(1 − D)]."
        accuracy = self.discriminator_update(
            self.discriminator, self.discriminator_adam, pairs=pairs, experts=self.experts, rng=rng
        )

        # Line 7: "Take a policy step, using the TRPO rule", with A = A_D + η A_C.
        with torch.no_grad():
            discriminator_reward = self.discriminator.reward(pairs).numpy()
            values = self.critics(states).numpy()
            next_values = self.critics(next_states).numpy()
        shaping = self.shaping(rollout.states.reshape(-1, self.collector.state_width))
        state_reward = shaping - shaping.mean() if settings.centered else shaping
        log_odds = self._reward_pairs(rollout)
        if self.pair_reward is not None:
            state_reward = state_reward + settings.pair_reward * (log_odds - log_odds.mean())
        rewards = [discriminator_reward, state_reward]
        if self.critics.count > len(rewards):
            rewards.append(state_reward + shaping.mean())
        advantages = self._compute_advantages(rollout, np.stack(rewards), values, next_values)
        advantage_d, advantage_c, *_ = advantages
        step = self.trust_region.step(
            self.policy,
            states,
            _flatten_steps(rollout.sampled_actions),
            _normalize(advantage_d + self.eta * advantage_c),
        )

        # Line 8: "Update η ← εη, when ΔV_D > ΔV_C", with V_C of the reward before centering: the
        # values of a reward of mean 0 hardly rise, whatever the policy does.
        rise_d, *_, rise_c = self._fit_critics(states, values + advantages, rng)
        self.eta = decay_eta(self.eta, settings.eta_decay, rise_d=rise_d, rise_c=rise_c)
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
            log_odds=float(log_odds.mean()),
        )

    def _sample_rollout(self, rng: np.random.Generator) -> Rollout:
        """Take `horizon` steps in every environment with the present policy and its noise."""
        settings = self.settings
        actions = len(self.collector.action_box.low)
        noise = rng.standard_normal((settings.horizon, settings.environments, actions))
        return self.collector.collect(self.snapshot(), noise.astype(np.float32))

    def _reward_pairs(self, rollout: Rollout) -> NDArray[np.float64]:
        """Return the pair reward of every step (T·N,), in the order of its states; 0 without."""
        if self.pair_reward is None:
            return np.zeros(rollout.ended.size)
        return reward_pairs(rollout, self.collector.action_box, self.pair_reward)

    def _compute_advantages(
        self, rollout: Rollout, *arrays: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """Return the advantages (c, T·N) of rewards, values and next values, each (c, T·N).

        They are A_D, A_C and, with a third critic, A_C before centering.

        With a pair reward, a real end is to V_C as a time limit (`pair_rewards` says why).
        """
        horizon, count = rollout.ended.shape
        ends = rollout.terminated
        ends_of_c = ends if self.pair_reward is None else np.zeros_like(ends)
        critics = self.critics.count
        parts = compute_advantages(
            *(array.reshape(critics, horizon, count).swapaxes(0, 1) for array in arrays),
            terminated=np.stack([ends] + [ends_of_c] * (critics - 1), axis=1),
            ended=rollout.ended[:, None],
            discount=self.settings.discount,
            gae_lambda=self.settings.gae_lambda,
        )
        return parts.swapaxes(0, 1).reshape(critics, -1)

    def _fit_critics(
        self, states: Tensor, targets: NDArray[np.floating], rng: np.random.Generator
    ) -> list[float]:
        """Fit the critics to targets (c, n); return how much each rose at the initial states."""
        settings = self.settings
        initial = self.standardize(self.initial)
        goals = torch.from_numpy(targets.astype(np.float32))
        with torch.no_grad():
            before = self.critics(initial).mean(dim=1)
        for _ in range(settings.critic_epochs):
            order = torch.from_numpy(rng.permutation(len(states)))
            for rows in order.split(settings.critic_batch):
                error = (self.critics(states[rows]) - goals[:, rows]) / self.critics.unit
                self.critic_adam.zero_grad()
                error.square().mean(dim=1).sum().backward()
                self.critic_adam.step()
        with torch.no_grad():
            return (self.critics(initial).mean(dim=1) - before).tolist()

    def standardize(self, states: NDArray[np.float32]) -> Tensor:
        """Map states (..., d) in raw units to the input of the networks, one row each, (n, d).

        Parameters
        ----------
        states:
            States, (..., d).
        """
        return torch.from_numpy(self.standardizer(states.reshape(-1, self.collector.state_width)))

    def snapshot(self, metadata: Mapping[str, Any] | None = None) -> Policy:
        """Return the present policy as plain arrays.

        Parameters
        ----------
        metadata:
            JSON about where it comes from, for a policy file.
        """
        return Policy(
            standardizer=self.standardizer,
            layers=self.policy.layers(),
            log_sigma=self.policy.log_sigma.detach().numpy().copy(),
            box=self.collector.action_box,
            metadata=metadata or {},
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything learned, and the optimizers' moments, by dotted names."""
        return collect_arrays(self._networks, self._optimizers)

    def restore(self, arrays: Mapping[str, NDArray[Any]], *, done: int, eta: float) -> None:
        """Take over the state of a learner of the same settings.

        Parameters
        ----------
        arrays:
            What its `arrays` returned.
        done:
            How many iterations it had done.
        eta:
            Its η.
        """
        restore_arrays(arrays, self._networks, self._optimizers)
        self.done = done
        self.eta = eta

    @property
    def _networks(self) -> dict[str, nn.Module]:
        """The networks by their names in a checkpoint."""
        return {
            "policy": self.policy,
            "critics": self.critics,
            "discriminator": self.discriminator,
        }

    @property
    def _optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """The optimizers by their names in a checkpoint."""
        return {
            "critic_adam": self.critic_adam,
            "discriminator_adam": self.discriminator_adam,
        }


def _make_adam(network: nn.Module, rate: float) -> torch.optim.Adam:
    """Make an optimizer of all parameters of a network."""
    return torch.optim.Adam(network.parameters(), lr=rate, fused=True)


def _flatten_steps(steps: NDArray[np.float32]) -> Tensor:
    """Turn (T, N, k) into (T·N, k)."""
    return torch.from_numpy(steps.reshape(-1, steps.shape[-1]))


def _normalize(advantage: NDArray[np.float64]) -> Tensor:
    """Shift and scale advantages (n,) to mean 0 and deviation 1."""
    away = advantage - advantage.mean()
    return torch.from_numpy((away / (away.std() + 1e-8)).astype(np.float32))
