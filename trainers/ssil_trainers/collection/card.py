"""The card of a collected dataset: how it was made and what was measured, in Markdown.

The text is in the templates of this folder, one for each world; here are the numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from ssil_trainers.collection.collect import Collection
from ssil_trainers.collection.quality_tiers import EXPERT
from ssil_trainers.collection.recording import Selection


@dataclass(frozen=True)
class TierSummary:
    """One row of a card's table of tiers.

    Parameters
    ----------
    tier, labeled:
        Which selections it describes.
    selections:
        All of them, at least one.
    """

    tier: str
    labeled: bool
    selections: Sequence[Selection]

    @property
    def pairs(self) -> int:
        """Number of pairs that are kept."""
        return sum(selection.pairs for selection in self.selections)

    @property
    def scores(self) -> list[float]:
        """Score of every episode; 1 is as good as the expert."""
        return [selection.score for selection in self.selections]

    @property
    def mean_score(self) -> float:
        """Mean score of the episodes."""
        return float(np.mean(self.scores))


@dataclass(frozen=True)
class DriverSummary:
    """One row of a card's table of drivers: how much of a tier one policy drove."""

    tier: str
    driver: str
    episodes: int
    pairs: int


def render_card(collection: Collection[Any], *, name: str, command: str) -> str:
    """Return the card of a collection.

    Parameters
    ----------
    collection:
        What was collected.
    name:
        Name of the dataset.
    command:
        The command line that makes the dataset again.

    Returns
    -------
    str
        Markdown.

    Examples
    --------
    A collection of one labeled and one unlabeled lap, without worse drivers:

    >>> from dataclasses import replace
    >>> from ssil_trainers.collection.card import render_card
    >>> from ssil_trainers.collection.collect import Collection
    >>> from ssil_trainers.collection.rc_lidar import RC_LIDAR, RCSettings
    >>> from ssil_trainers.collection.recording import RecordedEpisode, Selection
    >>> ones = np.ones((400, 20), dtype=np.float32)
    >>> lap = RecordedEpisode(ones, ones[:, :1], ones[:, 0], ones[:, :2], "truncated", "me")
    >>> selections = [Selection(lap, 400, 1.0, "expert", labeled) for labeled in (True, False)]
    >>> world = replace(RC_LIDAR, bands=())
    >>> collection = Collection(world, RCSettings(), expert_return=400.0, selections=selections)
    >>> print(render_card(collection, name="laps", command="…").splitlines()[0])
    # laps
    """
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=False,  # Markdown, and all values are the project's own
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["number"] = format
    world = collection.world
    return environment.get_template(world.card).render(
        name=name,
        command=command,
        settings=collection.settings,
        expert_return=collection.expert_return,
        bands=world.bands,
        tiers=summarize_tiers(collection),
        drivers=list(summarize_drivers(collection)),
        version=version,
        **world.card_values(collection.settings),
    )


def summarize_tiers(collection: Collection[Any]) -> list[TierSummary]:
    """Return a summary of the labeled expert, the unlabeled expert, and every tier.

    Parameters
    ----------
    collection:
        What was collected.

    Examples
    --------
    A collection of one labeled and one unlabeled lap, without worse drivers:

    >>> from dataclasses import replace
    >>> from ssil_trainers.collection.card import summarize_tiers
    >>> from ssil_trainers.collection.collect import Collection
    >>> from ssil_trainers.collection.rc_lidar import RC_LIDAR, RCSettings
    >>> from ssil_trainers.collection.recording import RecordedEpisode, Selection
    >>> ones = np.ones((400, 20), dtype=np.float32)
    >>> lap = RecordedEpisode(ones, ones[:, :1], ones[:, 0], ones[:, :2], "truncated", "me")
    >>> selections = [Selection(lap, 400, 1.0, "expert", labeled) for labeled in (True, False)]
    >>> world = replace(RC_LIDAR, bands=())
    >>> collection = Collection(world, RCSettings(), expert_return=400.0, selections=selections)
    >>> [(row.tier, row.labeled, row.pairs) for row in summarize_tiers(collection)]
    [('expert', True, 400), ('expert', False, 400)]
    """
    kinds = [(EXPERT, True), (EXPERT, False)]
    kinds += [(band.tier, False) for band in collection.world.bands]
    return [
        TierSummary(
            tier,
            labeled,
            [one for one in collection.selections if (one.tier, one.labeled) == (tier, labeled)],
        )
        for tier, labeled in kinds
    ]


def summarize_drivers(collection: Collection[Any]) -> Iterator[DriverSummary]:
    """Yield how much every policy drove of every tier, in the order of their first episodes.

    Parameters
    ----------
    collection:
        What was collected.

    Examples
    --------
    A collection of one labeled and one unlabeled lap, without worse drivers:

    >>> from dataclasses import replace
    >>> from ssil_trainers.collection.card import summarize_drivers
    >>> from ssil_trainers.collection.collect import Collection
    >>> from ssil_trainers.collection.rc_lidar import RC_LIDAR, RCSettings
    >>> from ssil_trainers.collection.recording import RecordedEpisode, Selection
    >>> ones = np.ones((400, 20), dtype=np.float32)
    >>> lap = RecordedEpisode(ones, ones[:, :1], ones[:, 0], ones[:, :2], "truncated", "me")
    >>> selections = [Selection(lap, 400, 1.0, "expert", labeled) for labeled in (True, False)]
    >>> world = replace(RC_LIDAR, bands=())
    >>> collection = Collection(world, RCSettings(), expert_return=400.0, selections=selections)
    >>> list(summarize_drivers(collection))
    [DriverSummary(tier='expert', driver='me', episodes=2, pairs=800)]
    """
    for tier in (EXPERT, *(band.tier for band in collection.world.bands)):
        of_tier = [one for one in collection.selections if one.tier == tier]
        for driver in dict.fromkeys(one.recorded.driver for one in of_tier):
            driven = [one for one in of_tier if one.recorded.driver == driver]
            yield DriverSummary(tier, driver, len(driven), sum(one.pairs for one in driven))
