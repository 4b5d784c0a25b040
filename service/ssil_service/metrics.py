"""What the service counts and times, for Prometheus; a registry of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4
from prometheus_client.metrics_core import CounterMetricFamily
from prometheus_client.registry import Collector

from ssil_service.queries.admission import BoundedExecutor
from ssil_service.queries.catalog import Cache

CONTENT_TYPE = CONTENT_TYPE_PLAIN_0_0_4
_METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "PATCH"})
_SECONDS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30)


class _Counters(Collector):
    """What others count, read whenever the metrics are asked for."""

    def __init__(self, known: Mapping[str, tuple[str, Callable[[], float]]]) -> None:
        self._known = known

    def collect(self) -> Iterator[CounterMetricFamily]:
        """Give every count."""
        for name, (text, read) in self._known.items():
            yield CounterMetricFamily(name, text, value=read())


class Metrics:
    """The service's metrics; those of queue, cache and jobs are read when they are asked for."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self._known: dict[tuple[str, str, int], Histogram] = {}
        labels = ("method", "route", "status")
        self._latency = Histogram(
            "ssil_request_seconds",
            "Time to answer.",
            labels,
            buckets=_SECONDS,
            registry=self.registry,
        )
        self._rows = Counter(
            "ssil_rows", "Rows of questions answered.", ("route",), registry=self.registry
        )
        self._jobs = Gauge("ssil_jobs", "Scoring jobs.", ("state",), registry=self.registry)

    def record_answer(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count and time an answer; methods that clients make up are one, as labels stay."""
        key = (method if method in _METHODS else "any", route, status)
        if key not in self._known:  # finding the labels takes longer than counting
            self._known[key] = self._latency.labels(*key)
        self._known[key].observe(seconds)

    def record_rows(self, route: str, count: int) -> None:
        """Count the rows of a question."""
        self._rows.labels(route).inc(count)

    def watch_middleware(
        self, *, requests: Callable[[], int], streams: Callable[[], int], held: Callable[[], int]
    ) -> None:
        """Read what is in flight whenever the metrics are asked for."""
        self._gauges(
            {
                "ssil_requests_in_flight": ("Requests not yet answered.", requests),
                "ssil_event_streams": ("Event streams that are followed.", streams),
                "ssil_held_bytes": ("Memory that questions and long answers take.", held),
            }
        )

    def record_jobs(self, counts: dict[str, int]) -> None:
        """Tell how many jobs are in each state."""
        for state, count in counts.items():
            self._jobs.labels(state).set(count)

    def watch_queries(self, gate: BoundedExecutor, texts: BoundedExecutor, cache: Cache) -> None:
        """Read queues and cache whenever the metrics are asked for."""
        gauges = {
            "ssil_questions_admitted": (
                "Large questions computed or waiting.",
                lambda: gate.admitted,
            ),
            "ssil_cache_bytes": (
                "Memory that cached fields, models and values take.",
                lambda: cache.bytes,
            ),
            "ssil_cache_entries": ("Cached fields, models and values.", lambda: len(cache)),
        }
        self._gauges(gauges)
        self.registry.register(
            _Counters(
                {
                    "ssil_questions_refused": ("Large questions refused.", lambda: gate.refused),
                    "ssil_texts_refused": ("Long JSON refused.", lambda: texts.refused),
                    "ssil_cache_hits": ("Answers from the cache.", lambda: cache.hits),
                    "ssil_cache_misses": ("Fields, models and values read.", lambda: cache.misses),
                }
            )
        )

    def _gauges(self, gauges: Mapping[str, tuple[str, Callable[[], float]]]) -> None:
        for name, (text, read) in gauges.items():
            Gauge(name, text, registry=self.registry).set_function(read)

    def text(self) -> bytes:
        """Return the metrics in Prometheus's text format."""
        return generate_latest(self.registry)
