"""Arrow bodies that differ from one read before only in their numbers are not read again.

A fleet sends the same form all the time. Whatever Arrow says of a body, it says in the bytes before
and after the numbers: where those are the same, so is what was found out about them.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_REMEMBERED, _LONGEST = 256, 4096


@dataclass(frozen=True)
class _ArrowTemplate:
    """What lies around numbers, and what they are."""

    head: bytes
    tail: bytes
    dtype: np.dtype[Any]
    shape: tuple[int, ...]


class ArrowTemplates:
    """The forms of bodies seen lately, by their length and what else decided about them."""

    def __init__(self) -> None:
        self._known: dict[Hashable, _ArrowTemplate] = {}

    def numbers(self, body: bytes, *conditions: Hashable) -> NDArray[Any] | None:
        """Return the numbers of a body whose form is known; they are the body's own."""
        form = self._known.get((len(body), *conditions))
        if form is None or not (body.startswith(form.head) and body.endswith(form.tail)):
            return None
        flat = np.frombuffer(body, form.dtype, math.prod(form.shape), len(form.head))
        return flat.reshape(form.shape)

    def learn(self, body: bytes, numbers: NDArray[Any], *conditions: Hashable) -> None:
        """Remember how a body is formed, if its numbers are these, uncopied, and little else."""
        first = _address(numbers) - _address(np.frombuffer(body, np.uint8))
        last = first + numbers.nbytes
        inside = numbers.size and numbers.flags.c_contiguous and first >= 0 and last <= len(body)
        if not inside or len(body) - numbers.nbytes > _LONGEST:
            return
        if len(self._known) >= _REMEMBERED:
            self._known.clear()
        form = _ArrowTemplate(body[:first], body[last:], numbers.dtype, numbers.shape)
        self._known[(len(body), *conditions)] = form


def _address(array: NDArray[Any]) -> int:
    return array.__array_interface__["data"][0]
