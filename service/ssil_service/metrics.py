"""What the service counts and times, for Prometheus; a registry of its own.

Whoever has a number gives a function that reads it: this module imports no other part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4
from prometheus_client.metrics_core import CounterMetricFamily
from prometheus_client.registry import Collector

CONTENT_TYPE = CONTENT_TYPE_PLAIN_0_0_4
_METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "PATCH"})
_SECONDS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30)

Read = Callable[[], float]
"""Returns a number as it is now."""


class _Counters(Collector):
    """Counts that are kept elsewhere, read whenever the metrics are collected."""

    def __init__(self, counters: Mapping[str, tuple[str, Read]]) -> None:
        self._counters = counters

    def collect(self) -> Iterator[CounterMetricFamily]:
        """Give every count."""
        for name, (text, read) in self._counters.items():
            yield CounterMetricFamily(name, text, value=read())


class Metrics:
    """The service's metrics, empty at first.

    Attributes
    ----------
    registry
        Prometheus's registry with all of them.
    """

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self._labeled: dict[tuple[str, str, int], Histogram] = {}
        self._latency = Histogram(
            "ssil_request_seconds",
            "Time to answer.",
            ("method", "route", "status"),
            buckets=_SECONDS,
            registry=self.registry,
        )
        self._rows = Counter(
            "ssil_rows", "Rows of queries answered.", ("route",), registry=self.registry
        )
        self._jobs = Gauge("ssil_jobs", "Scoring jobs.", ("state",), registry=self.registry)

    def record_answer(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count and time an answer.

        Parameters
        ----------
        method
            HTTP method; unknown ones count as one, as every label is kept for good.
        route
            Path of the route with its parameters' names.
        status
            HTTP status.
        seconds
            From the request's head to the answer's end.
        """
        key = (method if method in _METHODS else "any", route, status)
        if key not in self._labeled:  # finding the labels takes longer than counting
            self._labeled[key] = self._latency.labels(*key)
        self._labeled[key].observe(seconds)

    def record_rows(self, route: str, count: int) -> None:
        """Count the rows of a query.

        Parameters
        ----------
        route
            Last part of the route's path.
        count
            Rows of the answer.
        """
        self._rows.labels(route).inc(count)

    def record_jobs(self, counts: Mapping[str, int]) -> None:
        """Set how many scoring jobs there are.

        Parameters
        ----------
        counts
            Jobs in each state.
        """
        for state, count in counts.items():
            self._jobs.labels(state).set(count)

    def watch_middleware(self, *, requests: Read, streams: Read, held: Read) -> None:
        """Show what is in flight.

        Parameters
        ----------
        requests
            Requests that are not answered yet.
        streams
            Event streams that are followed.
        held
            Bytes of bodies and long answers in memory.
        """
        self._add_gauges(
            {
                "ssil_requests_in_flight": ("Requests not yet answered.", requests),
                "ssil_event_streams": ("Event streams that are followed.", streams),
                "ssil_held_bytes": ("Memory that queries and long answers take.", held),
            }
        )

    def watch_executors(self, *, admitted: Read, refused: Read, json_refused: Read) -> None:
        """Show the queues of large queries and of long JSON.

        Parameters
        ----------
        admitted
            Large queries that are computed or wait.
        refused
            Large queries refused since the start.
        json_refused
            Long JSON bodies and answers refused since the start.
        """
        self._add_gauges({"ssil_questions_admitted": ("Large queries in work or queue.", admitted)})
        self._add_counters(
            {
                "ssil_questions_refused": ("Large queries refused.", refused),
                "ssil_texts_refused": ("Long JSON refused.", json_refused),
            }
        )

    def watch_cache(self, *, size: Read, entries: Read, hits: Read, misses: Read) -> None:
        """Show the cache of fields, models and values.

        Parameters
        ----------
        size
            Bytes that it takes.
        entries
            Values that are cached.
        hits
            Values found in it since the start.
        misses
            Values that had to be read.
        """
        self._add_gauges(
            {
                "ssil_cache_bytes": ("Memory that cached fields, models and values take.", size),
                "ssil_cache_entries": ("Cached fields, models and values.", entries),
            }
        )
        self._add_counters(
            {
                "ssil_cache_hits": ("Answers from the cache.", hits),
                "ssil_cache_misses": ("Fields, models and values read.", misses),
            }
        )

    def text(self) -> bytes:
        """Return the metrics in Prometheus's text format."""
        return generate_latest(self.registry)

    def _add_gauges(self, gauges: Mapping[str, tuple[str, Read]]) -> None:
        for name, (text, read) in gauges.items():
            Gauge(name, text, registry=self.registry).set_function(read)

    def _add_counters(self, counters: Mapping[str, tuple[str, Read]]) -> None:
        self.registry.register(_Counters(counters))
