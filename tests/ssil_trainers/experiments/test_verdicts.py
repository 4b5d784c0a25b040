"""The rules on numbers made by hand, and the paper's claims against its own tables."""

from __future__ import annotations

import numpy as np
import pytest

from ssil_trainers.experiments import published
from ssil_trainers.experiments.claims import claims, controls
from ssil_trainers.experiments.tables import ESTIMATORS, TRAINING_TABLES
from ssil_trainers.experiments.verdicts import (
    TIE,
    Exceeds,
    Numbers,
    Rises,
    Steadier,
    Verdict,
    verdicts_by_chance,
)

LOW = [0.48, 0.50, 0.52]
MIDDLE = [0.2, 0.5, 0.8]
HIGH = [0.98, 1.0, 1.02]


def numbers(first: list[float], second: list[float]) -> Numbers:
    scores = {("t", 100, "a"): np.array(first), ("t", 100, "b"): np.array(second)}
    return Numbers(scores=scores)


def exceeds(first: list[float], second: list[float], factor: float = 1.0) -> Verdict:
    return Exceeds("t", 100, "a", "b", factor)(numbers(first, second)).verdict


@pytest.mark.parametrize(
    ("first", "second", "factor", "verdict"),
    [
        (HIGH, LOW, 1.0, Verdict.REPRODUCED),
        (HIGH, LOW, 2.0, Verdict.REPRODUCED),
        (HIGH, LOW, 1.2, Verdict.REPRODUCED),
        (HIGH, LOW, 3.0, Verdict.NOT_REPRODUCED),
        (LOW, HIGH, 1.0, Verdict.CONTRADICTED),
        (LOW, HIGH, 3.0, Verdict.CONTRADICTED),
        (MIDDLE, LOW, 1.0, Verdict.NOT_REPRODUCED),
        (LOW, LOW, 1.0, Verdict.NOT_REPRODUCED),
        (HIGH[:2], LOW, 1.0, Verdict.NOT_JUDGED),
        (HIGH, [], 1.0, Verdict.NOT_JUDGED),
    ],
)
def test_an_ordering_is_judged_by_its_support_and_its_size(
    first: list[float], second: list[float], factor: float, verdict: Verdict
):
    assert exceeds(first, second, factor) is verdict


def test_an_ordering_names_the_numbers_it_was_judged_by():
    found = Exceeds("t", 100, "a", "b", 3.0)(numbers(HIGH, LOW))
    assert "1.000 ± 0.020 (3 seeds) against 0.500 ± 0.020 (3 seeds)" in found.by
    assert "100%" in found.by and "less than claimed" in found.by


def test_a_row_that_was_not_run_is_not_judged():
    found = Exceeds("t", 100, "a", "missing")(numbers(HIGH, LOW))
    assert found.verdict is Verdict.NOT_JUDGED
    assert "found 0" in found.by


def steadier(first: list[float], second: list[float]) -> Verdict:
    return Steadier("t", 100, "a", "b")(numbers(first, second)).verdict


def test_a_deviation_is_judged_by_resampled_deviations():
    steady = list(np.linspace(0.99, 1.01, 10))
    shaky = list(np.linspace(0.1, 1.0, 10))
    assert steadier(steady, shaky) is Verdict.REPRODUCED
    assert steadier(shaky, steady) is Verdict.CONTRADICTED
    assert steadier(shaky, shaky) is Verdict.NOT_REPRODUCED
    assert steadier([1.0, 1.0], shaky) is Verdict.NOT_JUDGED


@pytest.mark.parametrize(
    ("tiers", "verdict"),
    [
        ([[0.1, 0.2, 0.3], [0.1, 0.4, 0.5], [0.0, 0.1, 0.9]], Verdict.REPRODUCED),
        ([[0.1, 0.2, 0.3], [0.1, 0.4, 0.3], [0.0, 0.1, 0.9]], Verdict.NOT_REPRODUCED),
        ([[0.3, 0.2, 0.1], [0.1, 0.2, 0.1], [0.9, 0.1, 0.0]], Verdict.CONTRADICTED),
        ([[0.1, 0.2, 0.3]], Verdict.NOT_JUDGED),
    ],
)
def test_a_rise_must_hold_in_every_seed(tiers: list[list[float]], verdict: Verdict):
    assert Rises("vae")(Numbers(tiers={"vae": np.array(tiers)})).verdict is verdict


def test_a_rise_of_an_estimator_that_was_not_run_is_not_judged():
    assert Rises("vae")(Numbers()).verdict is Verdict.NOT_JUDGED


def test_every_claim_is_about_numbers_that_the_tables_have():
    tables = {table.name: table for table in TRAINING_TABLES}
    for claim in (*claims(), *controls()):
        rule = claim.rule
        if isinstance(rule, Rises):
            assert rule.estimator in ESTIMATORS
            continue
        assert isinstance(rule, Exceeds | Steadier)
        keys = (
            (rule.better, rule.worse) if isinstance(rule, Exceeds) else (rule.steadier, rule.other)
        )
        assert rule.labels in tables[rule.table].labels
        for key in keys:
            assert key in {row.key for row in tables[rule.table].rows}, claim


def test_a_claimed_factor_is_that_of_the_papers_table_unless_a_note_says_otherwise():
    for claim in claims():
        rule = claim.rule
        if isinstance(rule, Exceeds) and not claim.note:
            better, worse = (
                published.SCORES[rule.table, rule.labels, key][0]
                for key in (rule.better, rule.worse)
            )
            assert better > worse, claim
            assert rule.factor == 1.0 or better / worse == pytest.approx(rule.factor, rel=2e-3)


def test_claimed_deviations_are_lower_in_the_papers_table():
    for claim in claims():
        rule = claim.rule
        if isinstance(rule, Steadier):
            first, second = (
                published.SCORES[rule.table, rule.labels, key][1]
                for key in (rule.steadier, rule.other)
            )
            assert first < second, claim
            if rule.share < 1:
                assert first / second == pytest.approx(rule.share, rel=2e-3)


def test_three_seeds_cannot_decide_a_deviation_and_say_so():
    shaky = [-9.0, 0.5, 9.0]
    rule = Steadier("t", 100, "a", "b")
    three = rule(numbers(HIGH, shaky))
    four = rule(numbers([*HIGH, 1.01], [*shaky, 3.0]))
    assert three.verdict is Verdict.NOT_REPRODUCED and "three seeds cannot" in three.by
    assert four.verdict is Verdict.REPRODUCED and "cannot" not in four.by


def test_a_share_of_a_deviation_is_ruled_out_by_its_interval():
    wide = np.linspace(0.1, 0.9, 12)
    narrow = np.linspace(0.3, 0.7, 12)
    both = numbers(list(narrow), list(wide))
    for share, verdict in ((0.6, Verdict.REPRODUCED), (0.1, Verdict.NOT_REPRODUCED)):
        found = Steadier("t", 100, "a", "b", share)(both)
        assert found.verdict is verdict
        assert ("less than claimed" in found.by) == (share == 0.1)


def test_differences_below_the_margin_are_ties_whatever_their_support():
    base = [0.5, 0.501, 0.502, 0.503]
    for off, verdict in ((0.9 * TIE, "tie"), (1.1 * TIE, "apart")):
        more = [value + off for value in base]
        for first, second in ((more, base), (base, more)):
            found = Exceeds("t", 100, "a", "b")(numbers(first, second))
            assert found.by.endswith("tie") == (verdict == "tie")
            assert (found.verdict is Verdict.NOT_REPRODUCED) == (verdict == "tie")
    steady = [0.5, 0.5, 0.5, 0.5, 0.5]
    less = [0.495, 0.5, 0.5, 0.505, 0.502]
    assert Steadier("t", 100, "a", "b")(numbers(steady, less)).by.endswith("tie")


def test_a_factor_beyond_the_highest_score_of_the_table_is_noted_and_changes_no_verdict():
    rule = Exceeds("t", 100, "a", "b", 3.0)
    found = rule(numbers(HIGH, LOW))
    assert found.by.endswith("ceiling: as much would be 1.500, the highest score is 1.020")
    scores = {**numbers(HIGH, LOW).scores, ("t", 300, "c"): np.array([1.6])}
    other = {**numbers(HIGH, LOW).scores, ("u", 300, "c"): np.array([1.6])}
    assert "ceiling" not in rule(Numbers(scores)).by
    assert "ceiling" in rule(Numbers(other)).by
    assert found.verdict is rule(Numbers(scores)).verdict is Verdict.NOT_REPRODUCED
    assert "ceiling" not in Exceeds("t", 100, "a", "b", 1.2)(numbers(HIGH, LOW)).by


def test_chance_makes_verdicts_about_equal_methods_in_a_share_that_seeds_decide():
    three = verdicts_by_chance(3)
    five = verdicts_by_chance(5)
    assert three is not None and five is not None
    assert three.means == pytest.approx(0.25, abs=0.03)
    assert five.means == pytest.approx(0.18, abs=0.03)
    assert three.deviations == 0 < five.deviations
    assert verdicts_by_chance(2) is None


def test_chance_makes_as_many_verdicts_as_the_rule_itself_of_scores_drawn_alike():
    rng = np.random.default_rng(5)
    verdicts = 0
    for _ in range(300):
        found = Exceeds("t", 100, "a", "b")(numbers(*rng.normal(size=(2, 3)).tolist()))
        verdicts += found.verdict is not Verdict.NOT_REPRODUCED
    expected = verdicts_by_chance(3)
    assert expected is not None
    assert verdicts / 300 == pytest.approx(expected.means, abs=0.07)


def test_a_claim_that_the_papers_table_denies_has_a_note():
    for claim in claims():
        rule = claim.rule
        if isinstance(rule, Exceeds):
            better, worse = (
                published.SCORES[rule.table, rule.labels, key][0]
                for key in (rule.better, rule.worse)
            )
            assert better > worse or "its own table says otherwise" in claim.note, claim


def test_statements_differ():
    statements = [claim.statement for claim in (*claims(), *controls())]
    assert len(set(statements)) == len(statements)
