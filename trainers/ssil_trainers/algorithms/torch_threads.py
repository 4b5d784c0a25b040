"""Running torch in one thread, so that sums are added in the same order on every machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def single_thread() -> Iterator[None]:
    """Limit torch to one thread inside the block, and restore its number of threads after it.

    Networks of 64 units are slower with several threads, and one thread adds floats in a fixed
    order, which makes training repeatable byte for byte.

    Examples
    --------
    >>> import torch
    >>> before = torch.get_num_threads()
    >>> with single_thread():
    ...     torch.get_num_threads()
    1
    >>> torch.get_num_threads() == before
    True
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
