"""gymnasium's conventions that both worlds follow: seeds, reset masks, options, actions, infos.

It knows no world: cars are rows.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.counts import check_count

Info = dict[str, Any]
StepResult = tuple[
    NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Info
]
"""States, rewards, terminated, truncated and info of all cars after a step."""


def check_seed(seed: object) -> int | None:
    """Return a seed in the form that gymnasium takes.

    Parameters
    ----------
    seed:
        A whole number of at least 0, or None.

    Returns
    -------
    int or None
        The seed.

    Raises
    ------
    InvalidInputError
        For anything else.

    Examples
    --------
    >>> from ssil_trainers.envs.vector import check_seed
    >>> check_seed(np.int64(3))
    3
    """
    return None if seed is None else check_count("seed", seed, least=0)


def assign_seeds(seed: object, cars: int) -> list[int | None]:
    """Return one seed for each car; None lets a car keep its own randomness.

    Parameters
    ----------
    seed:
        One seed s, for which car i gets s + i; or a sequence with one for each car; or None.
    cars:
        Number of cars.

    Returns
    -------
    list of int or None
        One for each car.

    Raises
    ------
    InvalidInputError
        For another number of seeds, or something that is no seed.

    Examples
    --------
    >>> from ssil_trainers.envs.vector import assign_seeds
    >>> assign_seeds(7, 3)
    [7, 8, 9]
    """
    if seed is None:
        return [None] * cars
    if isinstance(seed, list | tuple | np.ndarray):
        if len(seed) != cars:
            raise InvalidInputError(
                f"seed: expected one for each of {cars} cars, found {len(seed)}"
            )
        return [check_seed(one) for one in seed]
    first = check_count("seed", seed, least=0)
    return [first + row for row in range(cars)]


def read_reset_mask(options: Info | None, cars: int) -> NDArray[np.bool_]:
    """Return which cars to reset: those of options["reset_mask"], or all.

    Parameters
    ----------
    options:
        What the caller gave to `reset`.
    cars:
        Number of cars n.

    Returns
    -------
    ndarray of bool
        True for the cars to reset (n,); a copy.

    Raises
    ------
    InvalidInputError
        If the mask is no array of n booleans, or none of them is true.

    Examples
    --------
    >>> from ssil_trainers.envs.vector import read_reset_mask
    >>> read_reset_mask({"reset_mask": np.array([True, False])}, 2)
    array([ True, False])
    """
    mask = (options or {}).get("reset_mask")
    if mask is None:
        return np.ones(cars, dtype=np.bool_)
    known = isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (cars,)
    if not known or not mask.any():
        raise InvalidInputError(
            f"reset_mask: expected {cars} booleans in an array, one of them true, found {mask!r}"
        )
    return mask.copy()


def check_options(options: Info | None, known: Collection[str]) -> None:
    """Refuse an option of `reset` that the environment would ignore.

    Parameters
    ----------
    options:
        What the caller gave to `reset`.
    known:
        Names of the options that the environment reads.

    Raises
    ------
    InvalidInputError
        For an option of another name.

    Examples
    --------
    >>> from ssil_trainers.envs.vector import check_options
    >>> check_options({"start": None}, ("start", "reset_mask"))
    """
    for name in options or {}:
        if name not in known:
            raise InvalidInputError(
                f"options: expected {' or '.join(known) if known else 'none'}, found {name!r}"
            )


def check_actions(actions: ArrayLike, shape: tuple[int, ...] | None) -> NDArray[np.float64]:
    """Return actions as finite float64 numbers.

    Parameters
    ----------
    actions:
        What the caller gave to `step`.
    shape:
        Shape that they must have.

    Returns
    -------
    ndarray of float64
        The actions.

    Raises
    ------
    InvalidInputError
        For another shape, or for a number that is not finite, naming the car.

    Examples
    --------
    >>> from ssil_trainers.envs.vector import check_actions
    >>> check_actions([[0.5], [-1]], (2, 1)).tolist()
    [[0.5], [-1.0]]
    """
    try:
        values = np.asarray(actions, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidInputError(f"action: expected numbers, found {actions!r}") from None
    if values.shape != shape:
        raise InvalidInputError(f"action: expected shape {shape}, found {values.shape}")
    finite = np.isfinite(values)
    if not finite.all():
        car = int(np.argmin(finite.all(axis=-1)))
        found = f"{values[car]} for car {car}" if values.ndim > 1 else f"{values}"
        raise InvalidInputError(f"action: expected finite numbers, found {found}")
    return values


def require_reset(pending: NDArray[np.bool_], when: str = "first") -> None:
    """Refuse to step cars that have to be reset before.

    Parameters
    ----------
    pending:
        True for the cars that have to be reset (n,).
    when:
        End of the message: "first" before the first episode, empty after one has ended.

    Raises
    ------
    gymnasium.error.ResetNeeded
        If there is such a car.

    Examples
    --------
    >>> from ssil_trainers.envs.vector import require_reset
    >>> require_reset(np.array([False, False]))
    """
    if pending.any():
        raise ResetNeeded(f"cars {np.flatnonzero(pending)} must be reset {when}".rstrip())


def build_info(which: NDArray[np.bool_], **values: NDArray[np.float64]) -> Info:
    """Return values of some cars in the form of gymnasium's own vector environments.

    Parameters
    ----------
    which:
        True for the cars that the values hold for (n,).
    values:
        Values of all cars (n, ...) by name.

    Returns
    -------
    dict
        Each value, 0 for the other cars, beside its mask under the name with an underscore;
        empty if there is no such car.

    Examples
    --------
    >>> from ssil_trainers.envs.vector import build_info
    >>> build_info(np.array([True, False]), speed=np.array([4.0, 5.0]))
    {'speed': array([4., 0.]), '_speed': array([ True, False])}
    """
    info: Info = {}
    for name, of_cars in values.items() if which.any() else ():
        info[name] = np.where(which.reshape(-1, *[1] * (of_cars.ndim - 1)), of_cars, 0.0)
        info[f"_{name}"] = which.copy()
    return info


def build_final_info(ended: NDArray[np.bool_], states: NDArray[np.float32], info: Info) -> Info:
    """Return how episodes ended in a step that also begins the next ones.

    Parameters
    ----------
    ended:
        True for the cars whose episode ended (n,).
    states:
        Last states of these episodes (n, d); rows of other cars are ignored.
    info:
        Info of the last step of these episodes.

    Returns
    -------
    dict
        "final_obs" and "final_info" beside their masks, as gymnasium names them.

    Examples
    --------
    >>> from ssil_trainers.envs.vector import build_final_info
    >>> ended = np.array([False, True])
    >>> build_final_info(ended, np.array([[1.0], [2.0]], dtype=np.float32), {})["final_obs"]
    array([None, array([2.], dtype=float32)], dtype=object)
    """
    last = np.full(len(ended), None, dtype=object)
    for row in np.flatnonzero(ended):
        last[row] = states[row]
    masks = {"_final_obs": ended.copy(), "_final_info": ended.copy()}
    return {"final_obs": last, "final_info": info, **masks}
