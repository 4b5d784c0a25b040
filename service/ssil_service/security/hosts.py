"""Host and Origin checks against DNS rebinding when no API key is set.

A page of another site can make a browser on this machine send requests to any address. By binding
its own name to this machine (DNS rebinding) it can even read the answers; the browser then still
sends that name as Host and Origin, and so the service can refuse it.
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

_ABSOLUTE_TARGET = re.compile(rb"https?://([^/?#]*)(/.*)?", re.IGNORECASE)
_LOCAL_NAMES = ("localhost", "127.0.0.1", "[::1]")
SAFE = ("GET", "HEAD", "OPTIONS")
"""Methods that change nothing."""


@dataclass(frozen=True)
class Hosts:
    """Names under which the service may be addressed.

    Parameters
    ----------
    names
        In lower case, without a port; IPv6 addresses in brackets and in their shortest form.
    """

    names: frozenset[str]

    @classmethod
    def of(cls, settings: Settings, others: Iterable[str] = ()) -> Hosts:
        """Take the names of a service.

        Parameters
        ----------
        settings
            The address that it is bound to.
        others
            Further names, as in `Hosts.names`.

        Returns
        -------
        Hosts
            Those, and the local names.
        """
        host = settings.host
        bound = _shorten_ipv6(host) if ":" in host else host.lower()
        return cls(frozenset({*_LOCAL_NAMES, bound, *others}))

    def refuse_foreign(self, method: str, headers: Mapping[bytes, bytes]) -> None:
        """Check where a request comes from.

        Parameters
        ----------
        method
            HTTP method in upper case.
        headers
            Names in lower case.

        Raises
        ------
        Problem
            421 for another Host, 403 for another Origin of a method that is not safe.
        """
        host = headers.get(b"host", b"").decode("latin-1")
        if _without_port(host) not in self.names:
            raise Problem(
                421, "Host: not a local name; without API keys only local names are answered"
            )
        if method in SAFE:
            return
        origin = headers.get(b"origin")
        if origin is not None and origin.partition(b"://")[2] != host.encode("latin-1"):
            raise Problem(
                403, "Origin: another site; without API keys it may only use GET, HEAD and OPTIONS"
            )


def _without_port(host: str) -> str:
    """Return a Host header in the form of `Hosts.names`."""
    if host.startswith("["):
        return _shorten_ipv6(host[1:].partition("]")[0])
    return host.partition(":")[0].lower()


@lru_cache(64)
def _shorten_ipv6(address: str) -> str:
    """Return an IPv6 address in its shortest form, in brackets."""
    try:
        return f"[{ipaddress.IPv6Address(address)}]"
    except ValueError:
        return f"[{address.lower()}]"


def in_origin_form(scope: Scope) -> Scope:
    """Turn a request for `http://host/path` into one for `/path` of that host.

    Parameters
    ----------
    scope
        Of an HTTP request.

    Returns
    -------
    Scope
        The same if its target is a path already, or is not an absolute one either.

    Notes
    -----
    RFC 9112, section 3.2.2: a server must accept this form, and ignore the Host header for it.
    """
    if scope["path"].startswith("/"):
        return scope
    target = _ABSOLUTE_TARGET.fullmatch(scope["raw_path"])
    if target is None:
        return scope
    host = target[1]
    path = target[2] or b"/"
    headers = [(b"host", host), *(each for each in scope["headers"] if each[0] != b"host")]
    return {**scope, "path": unquote(path.decode("latin-1")), "raw_path": path, "headers": headers}
