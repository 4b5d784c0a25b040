"""Logs are lines of JSON, and nothing of the module `logging` itself is changed."""

import io
import json
import logging
import sys
from collections.abc import Iterator

import pytest

from ssil_service.logs import log_event, start_logging


@pytest.fixture
def stderr(monkeypatch: pytest.MonkeyPatch) -> Iterator[io.StringIO]:
    """Standard error of a process that has started logging."""
    root = logging.getLogger()
    monkeypatch.setattr(root, "handlers", [])
    monkeypatch.setattr(root, "level", root.level)
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    start_logging("info")
    yield stream
    root.setLevel(logging.WARNING)  # forgets which levels are logged


def lines(stderr: io.StringIO) -> list[dict]:
    return [json.loads(line) for line in stderr.getvalue().splitlines()]


def test_a_line_has_the_message_and_its_fields(stderr: io.StringIO):
    log_event("answered", status=200, path="/a")
    (line,) = lines(stderr)
    assert line["message"] == "answered" and line["level"] == "info"
    assert (line["status"], line["path"], line["logger"]) == (200, "/a", "ssil_service")
    assert line["time"].endswith("+00:00")


def test_a_trace_is_in_the_same_line(stderr: io.StringIO):
    try:
        raise ZeroDivisionError("here")
    except ZeroDivisionError:
        log_event("failed", level=logging.ERROR, trace=True)
    (line,) = lines(stderr)
    assert line["level"] == "error" and "ZeroDivisionError: here" in line["trace"]


def test_less_severe_events_are_not_logged(stderr: io.StringIO):
    log_event("detail", level=logging.DEBUG)
    assert lines(stderr) == []


def test_other_loggers_of_the_process_still_know_the_calling_line(stderr: io.StringIO):
    records: list[logging.LogRecord] = []

    class Recorder(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            records.append(record)

    handler = Recorder()
    other = logging.getLogger("test_logs.other")
    other.addHandler(handler)
    other.error("found")
    assert records[0].pathname == __file__ and records[0].thread is not None
    assert [line["message"] for line in lines(stderr)] == ["found"]
