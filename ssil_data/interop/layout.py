"""Which columns of a file are states, actions and so on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from ssil_data.interop.columns import SCALAR, Columns

_USUAL: Mapping[str, tuple[str, ...]] = {
    "state": ("states", "state"),
    "action": ("actions", "action"),
    "episode": ("episode",),
    # a column `step` may count anything; it is checked only if the layout names it
    "step": (),
    "reward": ("reward", "rewards"),
    "position": ("position", "positions"),
    "score": ("score",),
    "tier": ("tier",),
    "labeled": ("labeled",),
}
_GUESSED_SHAPES: Mapping[str, tuple[tuple[int, ...], ...]] = {
    "reward": ((), (1,)),
    "position": ((2,),),
    "score": ((), (1,)),
    "tier": ((), (1,)),
}


@dataclass(frozen=True)
class Layout:
    """Which columns of a file are states, actions and so on.

    What is not named here is taken from columns of the usual names (see `fill_layout`).

    Parameters
    ----------
    state, action
        Columns to join side by side, in this order.
    episode
        Column whose value changes where an episode ends; without one, the file is one episode.
    step
        Column that must rise by 1 within an episode; it is only checked.
    reward
        Column of the reward of each step.
    position
        Columns of x and y, in meters.
    score
        Column of an episode's true return.
    tier
        Column of an episode's quality tier.
    labeled
        Name of a column of true and false, or values of the episode column: `3`, `0-9`, `all`.
    """

    state: tuple[str, ...] = ()
    action: tuple[str, ...] = ()
    episode: str | None = None
    step: str | None = None
    reward: str | None = None
    position: tuple[str, ...] = ()
    score: str | None = None
    tier: str | None = None
    labeled: tuple[str, ...] = ()


def fill_layout(layout: Layout, columns: Columns) -> Layout:
    """Fill in what a layout does not name, from the columns of the usual names.

    A column that is named for one role is not taken for another. A reward, position, score or
    tier is taken only if it has the shape of one; a step never is, since a column `step` may
    count anything.

    Parameters
    ----------
    layout
        The columns that are named.
    columns
        Columns of the file.

    Returns
    -------
    Layout
        The same, with the usual columns of this file where it named none.
    """
    named = [getattr(layout, field.name) for field in fields(layout)]
    taken = {name for given in named for name in ([given] if type(given) is str else given or ())}
    filled: dict[str, Any] = {}
    for field in fields(layout):
        given = getattr(layout, field.name)
        usual = [
            name
            for name in _USUAL[field.name]
            if name not in taken and _may_be(columns, field.name, name)
        ][:1]
        if given or not usual:
            filled[field.name] = given
        else:
            filled[field.name] = usual[0] if field.default is None else tuple(usual)
    return Layout(**filled)


def _may_be(columns: Columns, role: str, name: str) -> bool:
    """Tell whether a column of a usual name has the shape of its role."""
    if name in columns.unreadable:
        return columns.unreadable[name] != SCALAR or role in ("state", "action", "labeled")
    shapes = _GUESSED_SHAPES.get(role)
    return name in columns and (shapes is None or columns[name].shape[1:] in shapes)
