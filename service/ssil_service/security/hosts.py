"""Under which names a service without keys is asked: a web page elsewhere must not reach it.

A page of another site can make a browser on this machine ask any address, and by rebinding its
own name (DNS) even read the answers; the browser then still tells that name as Host and Origin.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from urllib.parse import unquote

from starlette.types import Scope

from ssil_service.problems import Problem
from ssil_service.settings import Settings

_ABSOLUTE = re.compile(rb"https?://([^/?#]*)(/.*)?", re.IGNORECASE)
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
        bound = _format_address(settings.host) if ":" in settings.host else settings.host.lower()
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
    if host.startswith("["):
        return _format_address(host[1:].partition("]")[0])
    return host.partition(":")[0].lower()


@lru_cache(64)
def _format_address(address: str) -> str:
    """Return an address of version 6 as it is written shortest."""
    try:
        return f"[{ipaddress.IPv6Address(address)}]"
    except ValueError:
        return f"[{address.lower()}]"


def in_origin_form(scope: Scope) -> Scope:
    """Return a request for `http://host/path` as one for `/path` of that host (RFC 9112, 3.2.2)."""
    if scope["path"].startswith("/"):
        return scope
    found = _ABSOLUTE.fullmatch(scope["raw_path"])
    if found is None:
        return scope
    host, path = found[1], found[2] or b"/"
    headers = [(b"host", host), *(each for each in scope["headers"] if each[0] != b"host")]
    return {**scope, "path": unquote(path.decode("latin-1")), "raw_path": path, "headers": headers}
