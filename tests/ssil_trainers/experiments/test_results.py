"""Finished cells put together, from records made by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ssil_trainers.experiments.page import describe_saturation
from ssil_trainers.experiments.results import Results
from ssil_trainers.experiments.tables import RACETRACK, RC_LIDAR, Row, Table

GAIL = Row("gail", "GAIL")
CONSTANT = Row("constant", "constant reward", labeled=False)


def record(
    table: Table, row: Row, labels: int | None, score: float, *, seed: int = 0
) -> dict[str, Any]:
    cell = {
        "table": table.name,
        "method": row.method,
        "estimator": row.estimator,
        "labels": labels,
        "seed": seed,
    }
    curve = [{"steps": 0, "score": 0.0}, {"steps": 4_096, "score": score}]
    return {"identity": {"cell": cell}, "score": score, "full_score": 400.0, "curve": curve}


def leverage(preset: str, seed: int, tiers: list[float]) -> dict[str, Any]:
    cell = {
        "table": "leverage",
        "method": preset,
        "estimator": "vae",
        "labels": None,
        "seed": seed,
    }
    names = ("0-25", "25-50", "50-75", "expert")
    return {
        "identity": {"cell": cell},
        "mean_leverage_by_tier": dict(zip(names, tiers, strict=True)),
        "auroc": 0.9,
        "spearman": None,
    }


def test_every_number_of_labels_has_its_own_results_seed_after_seed():
    records = [
        record(RACETRACK, GAIL, labels, score + seed, seed=seed)
        for seed in (1, 0)
        for labels, score in ((300, 0.3), (100, 0.1))
    ]
    results = Results(records)
    assert results.scores(RACETRACK, GAIL, 100).tolist() == [0.1, 1.1]
    assert results.scores(RACETRACK, GAIL, 300).tolist() == [0.3, 1.3]
    assert results.scores(RACETRACK, GAIL, 600).tolist() == []
    judged_by = results.numbers([RACETRACK]).scores
    assert judged_by["racetrack", 300, "gail"].tolist() == [0.3, 1.3]
    assert [row["mean"] for row in results.rows(RACETRACK)] == pytest.approx([0.6, 0.8])


def test_a_row_without_labels_has_the_same_results_for_all_numbers_of_labels():
    results = Results([record(RACETRACK, CONSTANT, None, 0.2)])
    for labels in RACETRACK.labels:
        assert results.scores(RACETRACK, CONSTANT, labels).tolist() == [0.2]


def test_estimators_and_tables_are_not_mixed_up():
    vae = Row("ssil", "", "vae")
    gpr = Row("ssil", "", "gpr")
    results = Results([record(RACETRACK, vae, 100, 0.5), record(RACETRACK, gpr, 100, 0.7)])
    assert results.scores(RACETRACK, vae, 100).tolist() == [0.5]
    assert results.scores(RACETRACK, gpr, 100).tolist() == [0.7]
    assert results.scores(RC_LIDAR, vae, 100).tolist() == []


def test_a_rise_of_leverage_is_judged_by_the_papers_scale():
    rising = [0.1, 0.2, 0.3, 0.4]
    falling = [0.4, 0.3, 0.2, 0.1]
    results = Results([leverage("default", 0, falling), leverage("paper", 0, rising)])
    np.testing.assert_array_equal(results.numbers([]).tiers["vae"], [rising])
    shown = {row["preset"]: list(row["tiers"].values()) for row in results.leverage_rows()}
    assert shown == {"paper": pytest.approx(rising), "default": pytest.approx(falling)}


def test_the_most_on_the_training_track_stands_beside_the_final_score_on_others():
    records = [record(RC_LIDAR, GAIL, None, 0.5, seed=seed) for seed in (0, 1)]
    for seed, most in enumerate((0.7, 0.9)):
        records[seed]["curve"] = [
            {"steps": steps, "score": score} for steps, score in ((0, 0.1), (9, most), (18, 0.6))
        ]
    (row,) = Results(records).rows(RC_LIDAR)
    assert (row["mean"], row["where_trained"]) == (0.5, 0.6)
    assert row["most_where_trained"] == pytest.approx(0.8)
    assert row["most_deviation"] == pytest.approx(0.1 * 2**0.5)


def test_rows_have_the_laps_of_their_labels_where_they_are_known():
    records = [record(RACETRACK, GAIL, labels, 0.5) for labels in (100, 300)]
    records[1]["laps"] = 1.6
    records.append({**record(RACETRACK, CONSTANT, None, 0.2), "laps": 6.3})
    results = Results(records)
    assert [results.laps(RACETRACK, labels) for labels in RACETRACK.labels] == [
        None,
        1.6,
        None,
        None,
    ]
    assert {(row["labels"], row["laps"]) for row in results.rows(RACETRACK)} >= {(300, 1.6)}


def test_a_bounded_table_names_the_methods_that_reach_its_full_score():
    full = [record(RC_LIDAR, row, None, 1.0) for row in RC_LIDAR.rows if row.method != "clone"]
    clone = RC_LIDAR.rows[-1]
    sentence = describe_saturation(RC_LIDAR, Results([*full, record(RC_LIDAR, clone, None, 0.5)]))
    assert sentence.startswith("After 4,096 steps these score 1.000")
    assert "constant reward" in sentence and sentence.endswith("less: behavior cloning 0.500.")
    sentence = describe_saturation(
        RC_LIDAR, Results([*full, record(RC_LIDAR, clone, None, 0.9996)])
    )
    assert "every method and every control scores 1.000" in sentence
    below = Results([record(RC_LIDAR, GAIL, None, 0.9994)])
    assert describe_saturation(RC_LIDAR, below) == ""
    assert describe_saturation(RACETRACK, Results([record(RACETRACK, GAIL, 100, 1.02)])) == ""
