"""Logs as lines of JSON on standard error."""

from __future__ import annotations

import logging
from datetime import UTC, datetime

from pydantic_core import to_json

_FIELDS = "fields"

log = logging.getLogger("ssil_service")


class _Lines(logging.Formatter):
    """One JSON object per record."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line; what was logged with `told` lies beside the message."""
        line = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **getattr(record, _FIELDS, {}),
        }
        if record.exc_info:
            line["trace"] = self.formatException(record.exc_info)
        return to_json(line, fallback=str).decode()


def log_event(
    message: str, *, level: int = logging.INFO, trace: bool = False, **fields: object
) -> None:
    """Log a message with fields of its own."""
    if log.isEnabledFor(level):
        log.log(level, message, extra={_FIELDS: fields}, exc_info=trace)


def start_logging(level: str) -> None:
    """Send all logs of the process to standard error as lines of JSON."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Lines())
    # what a line does not show is not looked for
    logging._srcfile = None  # pyright: ignore[reportAttributeAccessIssue]
    logging.logThreads = logging.logProcesses = logging.logMultiprocessing = False
    root = logging.getLogger()
    root.handlers = [handler]
    root.setLevel(level.upper())
    for name in ("uvicorn", "uvicorn.error"):
        logging.getLogger(name).handlers = []
        logging.getLogger(name).propagate = True
