"""What both worlds ask and tell in gymnasium's forms: seeds, masks, options, actions and infos.

It knows no world: cars are rows.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.counts import count

Info = dict[str, Any]
Stepped = tuple[
    NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Info
]
"""States, rewards, terminated, truncated and info of all cars after a step."""


def one_seed(seed: object) -> int | None:
    """Return a seed as gymnasium takes it; raises InvalidInputError for what is none."""
    return None if seed is None else count("seed", seed, least=0)


def seeds_of_cars(seed: object, cars: int) -> list[int | None]:
    """Return one seed for each car: seed + i, or the i-th of a sequence; None keeps the car's own.

    Raises InvalidInputError for another number of them, or what is no seed.
    """
    if seed is None:
        return [None] * cars
    if isinstance(seed, list | tuple | np.ndarray):
        if len(seed) != cars:
            raise InvalidInputError(
                f"seed: expected one for each of {cars} cars, found {len(seed)}"
            )
        return [one_seed(one) for one in seed]
    first = count("seed", seed, least=0)
    return [first + row for row in range(cars)]


def reset_mask(options: Info | None, cars: int) -> NDArray[np.bool_]:
    """Return which cars (n,) to reset: those of options["reset_mask"], or all."""
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
    """Raise InvalidInputError for an option that would not be heard."""
    for name in options or {}:
        if name not in known:
            raise InvalidInputError(
                f"options: expected {' or '.join(known) if known else 'none'}, found {name!r}"
            )


def finite_actions(actions: ArrayLike, shape: tuple[int, ...] | None) -> NDArray[np.float64]:
    """Return the actions of that shape; raises InvalidInputError, also for one not finite."""
    try:
        given = np.asarray(actions, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidInputError(f"action: expected numbers, found {actions!r}") from None
    if given.shape != shape:
        raise InvalidInputError(f"action: expected shape {shape}, found {given.shape}")
    finite = np.isfinite(given)
    if not finite.all():
        car = int(np.argmin(finite.all(axis=-1)))
        found = f"{given[car]} for car {car}" if given.ndim > 1 else f"{given}"
        raise InvalidInputError(f"action: expected finite numbers, found {found}")
    return given


def refuse_before_reset(waiting: NDArray[np.bool_], when: str = "first") -> None:
    """Raise gymnasium's ResetNeeded if any of the cars (n,) waits for a reset."""
    if waiting.any():
        raise ResetNeeded(f"cars {np.flatnonzero(waiting)} must be reset {when}".rstrip())


def info_of(which: NDArray[np.bool_], **values: NDArray[np.float64]) -> Info:
    """Return values of some cars (n, ...), each beside the mask (n,) of those it holds for.

    Like gymnasium's own vector environments, it tells nothing where there is nobody to tell of.
    """
    info: Info = {}
    for name, of_cars in values.items() if which.any() else ():
        info[name] = np.where(which.reshape(-1, *[1] * (of_cars.ndim - 1)), of_cars, 0.0)
        info[f"_{name}"] = which.copy()
    return info


def final_info(ended: NDArray[np.bool_], states: NDArray[np.float32], info: Info) -> Info:
    """Return the last states (n, d) and info of the cars whose episode ended in a step that also
    begins another one.
    """
    last = np.full(len(ended), None, dtype=object)
    for row in np.flatnonzero(ended):
        last[row] = states[row]
    masks = {"_final_obs": ended.copy(), "_final_info": ended.copy()}
    return {"final_obs": last, "final_info": info, **masks}
