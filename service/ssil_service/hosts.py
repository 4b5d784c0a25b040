"""Under which names a service without keys is asked: a web page elsewhere must not reach it.

A page of another site can make a browser on this machine ask any address, and by rebinding its
own name (DNS) even read the answers; the browser then still tells that name as Host and Origin.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ssil_service.problems import Problem
from ssil_service.settings import Settings

_LOCAL = ("localhost", "127.0.0.1", "[::1]")
SAFE = ("GET", "HEAD", "OPTIONS")
"""Methods that change nothing."""


@dataclass(frozen=True)
class Hosts:
    """The names, in lower case, addresses of version 6 in brackets."""

    names: frozenset[str]

    @classmethod
    def of(cls, settings: Settings, others: Iterable[str] = ()) -> Hosts:
        """Take the local names, the address that the service is bound to, and others."""
        bound = f"[{settings.host}]" if ":" in settings.host else settings.host.lower()
        return cls(frozenset({*_LOCAL, bound, *others}))

    def refuse_foreign(self, method: str, headers: Mapping[bytes, bytes]) -> None:
        """Raise a Problem: 421 for another host, 403 for a change that another site asks for."""
        host = headers.get(b"host", b"").decode("latin-1")
        if _name(host) not in self.names:
            raise Problem(421, "Host: expected a local name, as no keys are set, found another")
        origin = headers.get(b"origin")
        foreign = origin is not None and origin.partition(b"://")[2] != host.encode("latin-1")
        if foreign and method not in SAFE:
            raise Problem(403, "Origin: expected this service, as no keys are set, found another")


def _name(host: str) -> str:
    """Return a host without its port."""
    name, bracket, _ = host.partition("]") if host.startswith("[") else host.partition(":")
    return (name + bracket if bracket == "]" else name).lower()
