"""API keys: a read key may query, a write key may also change; compared in constant time."""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Annotated

from fastapi import Request, Security
from fastapi.security import APIKeyHeader, HTTPAuthorizationCredentials, HTTPBearer
from pydantic import SecretStr

from ssil_data.errors import InvalidInputError
from ssil_service.problems import Problem
from ssil_service.settings import Settings

_DIGEST_PREFIX = "sha256:"
_SHORTEST_KEY = 16
_bearer = HTTPBearer(auto_error=False, description="A read or a write key.")
_header = APIKeyHeader(name="X-API-Key", auto_error=False, description="A read or a write key.")


@dataclass(frozen=True)
class Keys:
    """SHA-256 digests of the API keys; the keys themselves are not kept.

    True if there is any key; without one, everybody may do everything.

    Parameters
    ----------
    read
        Digests of keys that may query.
    write
        Digests of keys that may query and change.
    """

    read: tuple[bytes, ...]
    write: tuple[bytes, ...]

    @classmethod
    def of(cls, settings: Settings) -> Keys:
        """Take the keys of the settings.

        Parameters
        ----------
        settings
            `read_key` and `write_key`: keys separated by commas, plain or as `sha256:<hex>`.

        Returns
        -------
        Keys
            Their digests.

        Raises
        ------
        InvalidInputError
            For a key that is too short, is not ASCII, or a digest that is not one.
        """
        return cls(
            _digests("read_key", settings.read_key), _digests("write_key", settings.write_key)
        )

    def __bool__(self) -> bool:
        """Return whether there is any key."""
        return bool(self.read or self.write)

    def may(self, key: str, *, write: bool) -> tuple[bool, bool]:
        """Look a key up; the time does not depend on which key it is.

        Parameters
        ----------
        key
            As the client sent it.
        write
            Whether the client wants to change something.

        Returns
        -------
        known, allowed
            Whether it is one of the keys, and whether it may do this.
        """
        digest = hashlib.sha256(key.encode("utf-8", "surrogateescape")).digest()
        is_write_key = sum(hmac.compare_digest(digest, known) for known in self.write) > 0
        is_read_key = sum(hmac.compare_digest(digest, known) for known in self.read) > 0
        return is_write_key or is_read_key, is_write_key or (is_read_key and not write)


def refuse_open_access(settings: Settings) -> None:
    """Check that other machines cannot reach the service without a key.

    Parameters
    ----------
    settings
        Host and keys.

    Raises
    ------
    InvalidInputError
        If there is no key and the host is not a loopback address.
    """
    if not Keys.of(settings) and not _is_loopback(settings.host):
        raise InvalidInputError(
            f"host: expected a loopback address without keys, found {settings.host}; "
            "set SSIL_READ_KEY or SSIL_WRITE_KEY"
        )


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _digests(name: str, secret: SecretStr | None) -> tuple[bytes, ...]:
    """Return the digests of a setting's keys; `name` is the setting's, for messages."""
    given = "" if secret is None else secret.get_secret_value()
    return tuple(_digest(name, key.strip()) for key in given.split(",") if key.strip())


def _digest(name: str, key: str) -> bytes:
    """Return the digest of one key; no message shows the key."""
    if key.startswith(_DIGEST_PREFIX):
        return _read_digest(name, key)
    if not (key.isascii() and key.isprintable()):
        raise InvalidInputError(
            f"{name}: only printable ASCII can be sent in a header; choose another key"
        )
    if len(key) < _SHORTEST_KEY:
        raise InvalidInputError(
            f"{name}: expected at least {_SHORTEST_KEY} characters, found {len(key)}"
        )
    return hashlib.sha256(key.encode()).digest()


def _read_digest(name: str, key: str) -> bytes:
    try:
        digest = bytes.fromhex(key.removeprefix(_DIGEST_PREFIX))
    except ValueError:
        digest = b""
    if len(digest) != hashlib.sha256().digest_size:
        raise InvalidInputError(f"{name}: {_DIGEST_PREFIX} must be followed by 64 hex digits")
    return digest


async def _keys_of_request(
    request: Request,
    _one: Annotated[HTTPAuthorizationCredentials | None, Security(_bearer)],
    _other: Annotated[str | None, Security(_header)],
) -> list[str]:
    """Return all keys that a request brings, repeated headers too.

    FastAPI's own parameters serve the OpenAPI document only: they drop repeated headers. Other
    credentials than a bearer token count as an empty key, which is never valid.
    """
    credentials = (given.partition(" ") for given in request.headers.getlist("authorization"))
    bearers = [key.strip() if kind.lower() == "bearer" else "" for kind, _, key in credentials]
    return [*request.headers.getlist("x-api-key"), *bearers]


# both dependencies are asynchronous: FastAPI would run other functions in threads
RequestKeys = Annotated[list[str], Security(_keys_of_request)]
"""All keys that a request brings."""


def require_key(keys: Keys, *, write: bool) -> Callable[[list[str]], Awaitable[None]]:
    """Make the dependency of routes that need a key.

    Parameters
    ----------
    keys
        Those of the service.
    write
        Whether the routes change something, for which a read key does not do.

    Returns
    -------
    Callable
        Admits a request or raises a Problem: 401 without a valid key or with one wrong key beside
        it, 403 for a read key where a write key is needed.
    """

    async def check_keys(request_keys: RequestKeys) -> None:
        _check(keys, request_keys, write=write)

    return check_keys


def _check(keys: Keys, request_keys: list[str], *, write: bool) -> None:
    found = [keys.may(key, write=write) for key in request_keys]
    if not found or not all(known for known, _ in found):
        raise Problem(
            401,
            "API key: missing or invalid; send a valid one as bearer token or as X-API-Key",
            headers={"WWW-Authenticate": "Bearer"},
        )
    if not any(allowed for _, allowed in found):
        raise Problem(403, "API key: expected a write key, found a read key")
