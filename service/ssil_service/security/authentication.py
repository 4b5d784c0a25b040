"""Who may ask and who may change: keys, compared in constant time."""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
from dataclasses import dataclass
from typing import Annotated

from fastapi import Request, Security
from fastapi.security import APIKeyHeader, HTTPAuthorizationCredentials, HTTPBearer
from pydantic import SecretStr

from ssil_data.errors import InvalidInputError
from ssil_service.problems import Problem
from ssil_service.settings import Settings

_HASHED = "sha256:"
_bearer = HTTPBearer(auto_error=False, description="A read or a write key.")
_header = APIKeyHeader(name="X-API-Key", auto_error=False, description="A read or a write key.")


@dataclass(frozen=True)
class Keys:
    """Digests of the keys; a write key may also read."""

    read: tuple[bytes, ...]
    write: tuple[bytes, ...]

    @classmethod
    def of(cls, settings: Settings) -> Keys:
        """Take the keys of the settings; raises InvalidInputError for a short or odd one."""
        return cls(
            _digests("read_key", settings.read_key), _digests("write_key", settings.write_key)
        )

    def __bool__(self) -> bool:
        """Tell whether there is any key: without one, everybody may do everything."""
        return bool(self.read or self.write)

    def may(self, key: str, *, write: bool) -> tuple[bool, bool]:
        """Tell whether a key is known, and whether it may do this; every key is compared."""
        digest = hashlib.sha256(key.encode("utf-8", "surrogateescape")).digest()
        writes = sum(hmac.compare_digest(digest, known) for known in self.write) > 0
        reads = sum(hmac.compare_digest(digest, known) for known in self.read) > 0
        return writes or reads, writes or (reads and not write)


def refuse_open_doors(settings: Settings) -> None:
    """Raise InvalidInputError if other machines could reach the service without a key."""
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
    given = "" if secret is None else secret.get_secret_value()
    return tuple(_digest(name, key.strip()) for key in given.split(",") if key.strip())


def _digest(name: str, key: str) -> bytes:
    if key.startswith(_HASHED):
        try:
            digest = bytes.fromhex(key.removeprefix(_HASHED))
        except ValueError:
            digest = b""
        if len(digest) != 32:
            raise InvalidInputError(f"{name}: expected {_HASHED} and 64 hexadecimal digits")
        return digest
    if not (key.isascii() and key.isprintable()):  # a header could not bring it
        raise InvalidInputError(f"{name}: expected printable ASCII, found other characters")
    if len(key) < 16:
        raise InvalidInputError(f"{name}: expected at least 16 characters, found {len(key)}")
    return hashlib.sha256(key.encode()).digest()


async def _read_keys(
    request: Request,
    _one: Annotated[HTTPAuthorizationCredentials | None, Security(_bearer)],
    _other: Annotated[str | None, Security(_header)],
) -> list[str]:
    """Return all keys of a request; credentials of another kind are a key that is none."""
    credentials = (given.partition(" ") for given in request.headers.getlist("authorization"))
    bearers = [key.strip() if kind.lower() == "bearer" else "" for kind, _, key in credentials]
    return [*request.headers.getlist("x-api-key"), *bearers]


# asynchronous, all three: FastAPI would run others in threads
Given = Annotated[list[str], Security(_read_keys)]


async def may_read(request: Request, given: Given) -> None:
    """Let in whoever has a key."""
    _check(request, given, write=False)


async def may_write(request: Request, given: Given) -> None:
    """Let in whoever has a write key."""
    _check(request, given, write=True)


def _check(request: Request, given: list[str], *, write: bool) -> None:
    keys: Keys = request.app.state.keys
    found = [keys.may(key, write=write) for key in given]
    if not found or not all(known for known, _ in found):  # two keys: neither may be wrong
        raise Problem(
            401,
            "key: expected a valid one as bearer token or X-API-Key",
            headers={"WWW-Authenticate": "Bearer"},
        )
    if not any(allowed for _, allowed in found):
        raise Problem(403, "key: expected a write key, found a read key")
