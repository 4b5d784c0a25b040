"""The service as a store: `connect(url)` gives the surface of `Store` and the same numbers."""

from ssil_data.client.connection import Patience, ServiceError
from ssil_data.client.dataset import RemoteDataset
from ssil_data.client.field import RemoteField, RemoteModel
from ssil_data.client.jobs import JobFailedError, RemoteJob
from ssil_data.client.store import RemoteStore, connect

__all__ = [
    "JobFailedError",
    "Patience",
    "RemoteDataset",
    "RemoteField",
    "RemoteJob",
    "RemoteModel",
    "RemoteStore",
    "ServiceError",
    "connect",
]
