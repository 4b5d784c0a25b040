"""Metrics are what the parts count at the moment they are read."""

from ssil_service.metrics import Metrics


def value(metrics: Metrics, name: str, **labels: str) -> float | None:
    return metrics.registry.get_sample_value(name, labels)


def test_numbers_are_read_whenever_the_metrics_are():
    metrics = Metrics()
    count = 0
    metrics.watch_executors(
        admitted=lambda: count, refused=lambda: 2 * count, json_refused=lambda: 3 * count
    )
    metrics.watch_cache(
        size=lambda: 4 * count, entries=lambda: 5, hits=lambda: 6 * count, misses=lambda: 7
    )
    for count in (1, 10):
        assert value(metrics, "ssil_questions_admitted") == count
        assert value(metrics, "ssil_questions_refused_total") == 2 * count
        assert value(metrics, "ssil_texts_refused_total") == 3 * count
        assert value(metrics, "ssil_cache_bytes") == 4 * count
        assert value(metrics, "ssil_cache_hits_total") == 6 * count
    assert value(metrics, "ssil_cache_entries") == 5


def test_methods_that_clients_make_up_have_one_label():
    metrics = Metrics()
    for method in ("GET", "BREW", "STEEP"):
        metrics.record_answer(method, "/healthz", 200, 0.01)
    counts = {
        method: value(
            metrics, "ssil_request_seconds_count", method=method, route="/healthz", status="200"
        )
        for method in ("GET", "any", "BREW")
    }
    assert counts == {"GET": 1, "any": 2, "BREW": None}


def test_rows_and_jobs_are_counted():
    metrics = Metrics()
    metrics.record_rows("lcor", 20)
    metrics.record_rows("lcor", 5)
    metrics.record_jobs({"running": 2})
    assert value(metrics, "ssil_rows_total", route="lcor") == 25
    assert value(metrics, "ssil_jobs", state="running") == 2
    assert b"ssil_rows_total" in metrics.text()
