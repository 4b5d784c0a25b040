"""The card of a racetrack dataset: how it was made and what was measured, in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version

import numpy as np

from ssil_trainers.collection.ppo import PPOSettings
from ssil_trainers.collection.quality_tiers import BANDS, EXPERT
from ssil_trainers.collection.racetrack import Collected, RacetrackSettings
from ssil_trainers.collection.recording import Selection, drivers_table
from ssil_trainers.envs.racetrack.highway import HIGHWAY_IDS, SIMULATION_HZ
from ssil_trainers.envs.racetrack.starts import START_SPEEDS

_LIBRARIES = ("highway-env", "gymnasium", "stable-baselines3", "torch", "numpy")

_STATE = """\
| numbers | what | unit |
|---|---|---|
| 19 | rays from −90° (left) to 90° (right) to the edge of the road, at most 60 m | 60 m |
| 1 | heading error θ: the car's heading less the lane's | rad |
| 1 | offset from the road's centre line, right positive | 5 m |
| 2 | speed along and across the car's axis, with slip | 20 m/s |
| 1 | yaw rate | rad/s |
| 2 | previous action | as the action |
| 3 | curvature of the lane 5, 12 and 22 m ahead, right positive | 1/20 m |

Action: throttle (±5 m/s²) and steering (±45°), both in [−1, 1]. `position` is x, y in metres
before the action; `reward` is R after it."""


def racetrack_card(name: str, collected: Collected, *, command: str) -> str:
    """Return the card; command is the line that makes the dataset again."""
    settings, (slow, fast) = collected.settings, START_SPEEDS
    libraries = ", ".join(f"{library} {version(library)}" for library in _LIBRARIES)
    return f"""# {name}

Driving demonstrations after the protocol of the SSIL paper (Lee et al.): a trained PPO driver and
under-trained ones on highway-env's `{HIGHWAY_IDS[settings.track]}`, which stands for TORCS.

- Made by `{command}`
  with {libraries}.
  Same seed, same versions, same kind of machine: same data.
- {settings.labeled:,} labeled expert pairs, {settings.unlabeled:,} unlabeled expert pairs and
  {settings.unlabeled:,} unlabeled negative pairs, a third from each tier.
- Licence: Apache-2.0; simulated by this project, nothing recorded from others.

## Tiers, measured

A score is the return of a whole episode ({settings.episode_steps:,} steps at most) over the
expert's mean return, which is {collected.expert_return:,.0f}.

{_tiers(collected)}

`score`, `tier` and `reward` are for evaluation only: no estimator and no trainer reads them.

## State

{_STATE}

## How it was made

- Simulator: {_alone(settings)}, {SIMULATION_HZ} Hz simulation, {settings.policy_hz} Hz decisions, \
speeds 0–20 m/s.
  An episode starts anywhere on the lap, in the middle of a lane, at {slow:.0f}–{fast:.0f} m/s; it
  ends beyond the edge of the road and is cut off after {settings.episode_steps:,} steps.
- R = v_x cos θ − |v_y sin θ| − 2 v_x |d sin θ| − v_y cos θ, speeds in m/s, d the offset in 5 m.
- Drivers: {_describe_training(settings)}
- Actions: every driver acts by the mean of its policy plus normal noise of deviation
  {settings.action_noise:g}, clipped to [−1, 1]: the same for all, so that noise tells nobody apart.
{_describe_selection(settings)}\
- The expert is the checkpoint of its run with the highest mean return over {settings.measure}
  episodes. A checkpoint of the other runs stands for a tier if its mean score over
  {settings.measure} episodes and half of those episodes (or as many as the best such checkpoint
  has) lie in the band; at most {settings.policies} stand for one tier, spread evenly over the mean
  scores found. They drive in turns, and an episode is kept if its own score lies in the band.
- Labeled episodes are the first {settings.segment} pairs of different expert episodes; no labeled
  episode is unlabeled elsewhere. `ending` is "cut" where an episode was cut to fit the counts.

## Drivers

{drivers_table(collected.taken, (EXPERT, *(band.tier for band in BANDS)))}
"""


def _alone(settings: RacetrackSettings) -> str:
    if not settings.other_vehicles:
        return "one car"
    return (
        f"one car among up to {settings.other_vehicles} of highway-env's, which stop rays and end "
        "an episode when hit"
    )


def _describe_selection(settings: RacetrackSettings) -> str:
    """Tell how the usual trembling was chosen; another one is the caller's choice."""
    if settings.action_noise != RacetrackSettings().action_noise:
        return ""
    return """\
  The deviation was chosen among 0, 0.1, 0.2 and 0.3 after a look at how a VAE and a windowVAE
  order the tiers in trials with other drivers: below 0.3 their min–max leverage did not
  always rise over all four. Figures of leverage on such data are therefore not blind to that
  choice.
"""


def _tiers(collected: Collected) -> str:
    rows = ["| tier | labeled | episodes | pairs | score: mean | min | max | steps | speed, m/s |"]
    rows.append("|---|---|---|---|---|---|---|---|---|")
    groups = [(EXPERT, True), (EXPERT, False), *((band.tier, False) for band in BANDS)]
    for tier, labeled in groups:
        taken = [t for t in collected.taken if (t.tier, t.labeled) == (tier, labeled)]
        rows.append(f"| {tier} | {'yes' if labeled else 'no'} | {_describe_scores(taken)} |")
    rows.append("\nsteps: mean length of the whole episodes; speed: mean over the pairs.")
    return "\n".join(rows)


def _describe_scores(taken: Sequence[Selection]) -> str:
    scores = [t.score for t in taken]
    steps = np.mean([len(t.drive) for t in taken])
    speed = 20 * np.mean(np.concatenate([t.drive.states[: t.pairs, 21] for t in taken]))
    return (
        f"{len(taken)} | {sum(t.pairs for t in taken):,} | {np.mean(scores):.3f} | "
        f"{min(scores):.3f} | {max(scores):.3f} | {steps:.0f} | {speed:.1f}"
    )


def _describe_training(settings: RacetrackSettings) -> str:
    return (
        f"stable-baselines3's PPO on the reward R.\n"
        f"  One expert run: {_run(settings.expert)}.\n"
        f"  {settings.runs} under-trained runs: {_run(settings.under_trained)}."
    )


def _run(ppo: PPOSettings) -> str:
    return (
        f"{ppo.steps:,} steps, learning rate {ppo.learning_rate:g}, "
        f"a checkpoint every {ppo.keep_every * ppo.rollout * ppo.environments:,}"
    )
