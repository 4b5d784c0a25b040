"""Leverage and LCoR over REST, on the same store; it stands on ssil_data and knows no trainer.

`embed(store)` serves a store in this process, without a socket.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ssil_service.app import create_app
    from ssil_service.server.embedded import embed
    from ssil_service.settings import Settings

_HOME = {"Settings": "settings", "create_app": "app", "embed": "server.embedded"}

__all__ = ["Settings", "create_app", "embed"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
