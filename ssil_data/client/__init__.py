"""The service as a store: `connect(url)` gives the methods of `Store` and the same numbers.

Names are imported when they are first used: a process that only reads the wire needs no torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ssil_data.client.connection import RetryPolicy, ServiceError
    from ssil_data.client.dataset import RemoteDataset
    from ssil_data.client.field import RemoteField, RemoteModel
    from ssil_data.client.jobs import JobFailedError, RemoteJob
    from ssil_data.client.runs import RemoteRuns
    from ssil_data.client.store import RemoteStore, connect

_HOME = {
    "JobFailedError": "jobs",
    "RetryPolicy": "connection",
    "RemoteDataset": "dataset",
    "RemoteField": "field",
    "RemoteJob": "jobs",
    "RemoteModel": "field",
    "RemoteRuns": "runs",
    "RemoteStore": "store",
    "ServiceError": "connection",
    "connect": "store",
}

__all__ = [
    "JobFailedError",
    "RemoteDataset",
    "RemoteField",
    "RemoteJob",
    "RemoteModel",
    "RemoteRuns",
    "RemoteStore",
    "RetryPolicy",
    "ServiceError",
    "connect",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
