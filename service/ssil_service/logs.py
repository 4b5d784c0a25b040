"""Logs as lines of JSON on standard error."""

from __future__ import annotations

import logging
import sys
from datetime import UTC, datetime

from pydantic_core import to_json

_FIELDS = "fields"

log = logging.getLogger("ssil_service")


class _JsonFormatter(logging.Formatter):
    """One JSON object per record."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line, with the fields of `log_event` beside the message."""
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
    """Log what happened, with facts about it.

    Parameters
    ----------
    message
        What happened; the same words for every event of a kind.
    level
        Severity, as the module `logging` counts it.
    trace
        Whether to add the traceback of the exception that is being handled.
    **fields
        Facts; they stand beside the message in the line.
    """
    if log.isEnabledFor(level):
        # made here, as `log.log` would look for the calling line, which no line of the log shows
        error = sys.exc_info() if trace else None
        extra = {_FIELDS: fields}
        log.handle(log.makeRecord(log.name, level, __file__, 0, message, (), error, extra=extra))


def start_logging(level: str) -> None:
    """Send all logs of the process to standard error as lines of JSON.

    Parameters
    ----------
    level
        Least severity that is logged, in any case: "debug", "info", "warning" or "error".
    """
    handler = logging.StreamHandler()
    handler.setFormatter(_JsonFormatter())
    root = logging.getLogger()
    root.handlers = [handler]
    root.setLevel(level.upper())
    for name in ("uvicorn", "uvicorn.error"):
        logging.getLogger(name).handlers = []
        logging.getLogger(name).propagate = True
