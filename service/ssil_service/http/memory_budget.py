"""How much memory the bodies and long answers of all requests together may take."""

from __future__ import annotations

from ssil_service.problems import busy


class MemoryBudget:
    """Bytes of bodies, and of long answers to queries, that are in memory now.

    The only request in memory may take any number of bytes, as other limits bound a single
    request; otherwise one that does not fit is refused.

    Parameters
    ----------
    limit
        Most bytes of all requests together (`--held-bytes`).
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.bytes = 0

    def reserve(self, size: int, *, reserved: int) -> None:
        """Count more bytes for a request; the request gives them back with `release`.

        Parameters
        ----------
        size
            Bytes that the request needs in addition.
        reserved
            Bytes that this request has reserved before.

        Raises
        ------
        Problem
            503, retry after 1 s, if others hold memory and the sum exceeds the limit.
        """
        others_hold_memory = self.bytes > reserved
        if others_hold_memory and self.bytes + size > self.limit:
            raise busy(
                503, f"Requests hold too much memory (limit {self.limit} bytes); retry after 1 s", 1
            )
        self.bytes += size

    def release(self, size: int) -> None:
        """Give back bytes that were reserved.

        Parameters
        ----------
        size
            All that the request reserved, or a part of it.
        """
        self.bytes -= size
