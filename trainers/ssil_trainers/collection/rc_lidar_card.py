"""The card of an RC dataset: how it was made and what was measured, in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version

import numpy as np

from ssil_trainers.collection.quality_tiers import EXPERT
from ssil_trainers.collection.rc_lidar import RC_BANDS, RCCollected, RCSettings
from ssil_trainers.collection.recording import Selection, drivers_table
from ssil_trainers.envs.rc_lidar.tracks import TEST_TRACKS, TRAINING_TRACK, find_track

_LIBRARIES = ("numba", "gymnasium", "stable-baselines3", "torch", "numpy")
_NEARLY = 0.01
"""So near to 1, a number of laps is called one: the usual 401 pairs are a step more."""


def rc_card(name: str, collected: RCCollected, *, command: str) -> str:
    """Return the card; command is the line that makes the dataset again."""
    settings, car, drives = collected.settings, collected.car, _drives(collected)
    libraries = ", ".join(f"{library} {version(library)}" for library in _LIBRARIES)
    return f"""# {name}

Demonstrations of an RC car with a LiDAR after the protocol of the SSIL paper (Lee et al.): expert
{drives} and drives by under-trained policies of {len(RC_BANDS)} qualities, in simulation.

- Made by `{command}`
  with {libraries}.
  Same seed, same versions, same kind of machine: same data.
- {settings.laps} expert {drives} of {settings.lap_steps} pairs, the first half of them labeled, and
  {settings.negatives:,} unlabeled negative pairs, a quarter from each quality, collisions included.
- {_tracks(settings)}
- Licence: Apache-2.0; simulated by this project, nothing recorded from others.

## Tiers, measured

A score is the number of steps that a whole episode survives over the expert's
{collected.expert_return:.0f}.

{_tiers(collected)}

`score`, `tier` and `reward` are for evaluation only: no estimator and no trainer reads them.

## State

| numbers | what | unit |
|---|---|---|
| 19 | ranges of beams from −90° (right) to 90° (left), at most {car.reach:g} m | {car.reach:g} m |
| 1 | previous steering, 0 at the start | as the action |

Action: steering in [−1, 1], left positive, ±{car.steering_degrees:g}° of the wheels. `position` is
x, y of the rear axle in metres before the action; `reward` is 1 after an action that is survived.

## How it was made

- Simulator: `RCLidar-v0`, a kinematic bicycle at {car.speed:g} m/s, {car.hz:g} decisions a second,
  wheels with a lag of {car.steering_lag:g} s, LiDAR noise of {car.noise:.0%} of the range. An
  episode starts anywhere on the lap, up to {100 * car.start_aside:.0f} cm off the centre line and
  {car.start_askew_degrees:g}° askew; it ends when the car's rectangle touches a wall and is cut
  off after {settings.lap_steps} steps, {_of_a_lap(collected)}.
- Expert: pure pursuit of the centre line {settings.ahead:g} m ahead. It steers by its pose, which
  is not in the state: a person who knows the track.
- Negatives: {settings.runs} runs of stable-baselines3's PPO on the reward, {_run(settings)}.
- Actions: every driver acts by the mean of its policy plus normal noise of deviation
  {settings.action_noise:g}, clipped to [−1, 1]: the same for all, so that noise tells nobody apart.
- A checkpoint stands for a quality if its mean score over {settings.measure} episodes and half of
  those episodes (or as many as the best such checkpoint has) lie in the band; at most
  {settings.policies} stand for one, spread evenly over the mean scores found. They drive in turns,
  and an episode is kept if its own score lies in the band; of one at
  most {settings.segment} pairs are kept, the last, which lead to the wall.
{_describe_selection(settings)}
## Drivers

{drivers_table(collected.taken, (EXPERT, *(band.tier for band in RC_BANDS)))}
"""


def _tracks(settings: RCSettings) -> str:
    """Tell where the dataset was driven, and what its policies have not seen if that is so."""
    here = f"Collected on the track `{settings.track}`."
    others = (TRAINING_TRACK, *TEST_TRACKS)
    if settings.track in others:
        task = "trained" if settings.track == TRAINING_TRACK else "tested"
        return f"{here} It is no other than policies are {task} on."
    tests = ", ".join(f"`{track}`" for track in TEST_TRACKS)
    return f"""{here} Policies are trained on another one,
  `{TRAINING_TRACK}`, and tested on {tests}."""


def _of_a_lap(collected: RCCollected) -> str:
    """Tell how much of a lap down the centre line the time limit is."""
    return "one lap" if _is_lap(collected) else f"{_laps(collected):.2g} of a lap"


def _drives(collected: RCCollected) -> str:
    return "laps" if _is_lap(collected) else "drives"


def _is_lap(collected: RCCollected) -> bool:
    return abs(_laps(collected) - 1) < _NEARLY


def _laps(collected: RCCollected) -> float:
    track = find_track(collected.settings.track)
    return collected.settings.lap_steps / collected.car.lap_steps(track)


def _describe_selection(settings: RCSettings) -> str:
    """Tell what the usual settings were chosen by; others are the user's own choice."""
    if settings != RCSettings():
        return ""
    return f"""
Two choices were made after a look at what follows from them. Lag, noise, trembling and the tracks:
so that a network that clones the labeled pairs drives about three quarters of a lap on
`{TRAINING_TRACK}`. And the number of runs, of policies for one quality and of pairs of one drive:
a quality of one or two drives had a mean leverage that was a matter of luck.
"""


def _tiers(collected: RCCollected) -> str:
    rows = ["| tier | labeled | episodes | pairs | collisions | score: mean | min | max |"]
    rows.append("|---|---|---|---|---|---|---|---|")
    groups = [(EXPERT, True), (EXPERT, False), *((band.tier, False) for band in RC_BANDS)]
    for tier, labeled in groups:
        taken = [t for t in collected.taken if (t.tier, t.labeled) == (tier, labeled)]
        rows.append(f"| {tier} | {'yes' if labeled else 'no'} | {_describe_scores(taken)} |")
    rows.append("\ncollisions: episodes that are kept to their end at a wall.")
    return "\n".join(rows)


def _describe_scores(taken: Sequence[Selection]) -> str:
    scores = [t.score for t in taken]
    collisions = sum(t.episode().ending == "terminated" for t in taken)
    return (
        f"{len(taken)} | {sum(t.pairs for t in taken):,} | {collisions} | "
        f"{np.mean(scores):.3f} | {min(scores):.3f} | {max(scores):.3f}"
    )


def _run(settings: RCSettings) -> str:
    ppo = settings.under_trained
    return (
        f"{ppo.steps:,} steps each,\n  learning rate {ppo.learning_rate:g}, "
        f"a checkpoint every {ppo.keep_every * ppo.rollout * ppo.environments:,}"
    )
