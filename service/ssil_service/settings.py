"""The service's settings: environment variables and flags, by one class."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter
from pydantic import Field, SecretStr, ValidationError
from pydantic_settings import BaseSettings, SettingsConfigDict

from ssil_data.errors import InvalidInputError
from ssil_data.store.folder import Folder

Count = Annotated[int, Field(ge=1)]
Bytes = Annotated[int, Field(ge=1024)]
Seconds = Annotated[float, Field(gt=0, le=86_400, allow_inf_nan=False)]
_Secret = Annotated[SecretStr | None, Parameter(parse=False)]


class Settings(BaseSettings):
    """Every setting is an environment variable, `SSIL_<NAME>`; all but the keys are flags as well.

    Parameters are the fields below; what is not given is taken from the environment.
    """

    model_config = SettingsConfigDict(env_prefix="SSIL_", frozen=True, extra="ignore")

    store: str = "datasets"
    """Folder or object-store prefix of datasets."""
    state: Path | None = None
    """Folder of the job journal and of unfinished uploads; by default `.service` in the store."""
    host: str = "127.0.0.1"
    """Address to bind to; any but a loopback address needs a key."""
    port: Annotated[int, Field(ge=0, le=65_535)] = 8000
    """Port to bind to; 0 takes a free one."""
    read_key: _Secret = None
    """Keys that may read and query, separated by commas: plain, or sha256:<hex digest of a key>."""
    write_key: _Secret = None
    """Keys that may also upload, delete, and start and cancel jobs."""

    body_bytes: Bytes = 64 * 2**20
    """Largest body of a query."""
    json_bytes: Bytes = 4 * 2**20
    """Largest body that is JSON, which in memory takes up to thirty times its length."""
    held_bytes: Bytes = 2**29
    """Most memory for the bodies and long answers of all queries together; beyond it 503."""
    upload_bytes: Bytes = 2**30
    """Largest body of an upload."""
    decoded_bytes: Bytes = 2 * 2**30
    """Most memory that a Parquet body or an upload may take when it is decoded."""
    query_rows: Count = 65_536
    """Most rows of one query."""
    page_rows: Count = 262_144
    """Most rows of one page of an answer."""
    requests: Count = 256
    """Most requests in flight; beyond it 503."""
    event_streams: Count = 64
    """Most event streams at once; beyond it 503."""
    connections: Count = 512
    """Most connections; beyond it they are closed at once."""
    computing: Count = 2
    """Large queries that are computed at once, each on all processors."""
    waiting: Annotated[int, Field(ge=0)] = 16
    """Large queries that may wait for that; beyond it 503."""
    jobs: Count = Field(default_factory=lambda: os.cpu_count() or 1)
    """Scoring jobs that run at once, one process each."""
    job_queue: Annotated[int, Field(ge=0)] = 64
    """Scoring jobs that may wait; beyond it 429."""
    job_seconds: Seconds = 3600
    """A scoring job that takes longer is stopped."""
    job_bytes: Bytes = 8 * 2**30
    """Most memory that a scoring job may take."""
    decode_seconds: Seconds = 120
    """An upload or a Parquet body that takes longer to decode and store is refused."""
    cache_bytes: Bytes = 2**30
    """Memory for the fields, models and values of earlier queries."""

    header_seconds: Seconds = 10
    """Time for a request's head to arrive."""
    body_seconds: Seconds = 30
    """Time for a body to arrive, and a second more for every 64 KiB of it."""
    send_seconds: Seconds = 30
    """Time for a client to read an answer, and a second more for every 64 KiB of it."""
    grace_seconds: Seconds = 30
    """Time to finish what was accepted after SIGTERM, requests and jobs together."""
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    """Least severity that is logged, as lines of JSON on standard error."""

    @property
    def state_folder(self) -> Path:
        """The folder of the service's own state.

        Raises
        ------
        InvalidInputError
            For a store that is no folder, without `state`.
        """
        if self.state is not None:
            return self.state
        local = Folder(self.store).local
        if local is None:
            raise InvalidInputError(
                f"state: the store {self.store} is no folder on this machine; "
                "name one for the service's own state with --state"
            )
        return local / ".service"


def read_settings(**given: Any) -> Settings:
    """Make the settings.

    Parameters
    ----------
    **given
        Settings by name; the others come from the environment, or have their defaults.

    Returns
    -------
    Settings
        All of them.

    Raises
    ------
    InvalidInputError
        Naming every wrong one, in one line and without its value, which may be secret.
    """
    try:
        return Settings(**given)
    except ValidationError as error:
        raise InvalidInputError(explain_errors(error)) from None


def explain_errors(error: ValidationError) -> str:
    """Describe which settings are wrong.

    Parameters
    ----------
    error
        What pydantic raised.

    Returns
    -------
    str
        One line, without the values: they may be secret.
    """
    faults = error.errors(include_input=False, include_url=False)
    return "; ".join(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in faults)
