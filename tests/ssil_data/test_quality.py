"""Ranks and tiers are judged as other libraries and hand-made cases judge them."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.metrics import roc_auc_score

from ssil_data.calibration import find_calibration
from ssil_data.commands.output import StoreLocation, print_table
from ssil_data.commands.show import show
from ssil_data.errors import InvalidInputError
from ssil_data.estimators import GPR
from ssil_data.quality import (
    auroc,
    compare_with_tiers,
    measure_quality,
    partial_spearman,
    spearman,
)
from ssil_data.scoring import score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive

values = st.lists(st.integers(0, 20), min_size=3, max_size=60)


@settings(deadline=None)  # on a busy machine any call may wait
@given(values, values)
def test_auroc_is_scikit_learns(high: list[int], low: list[int]):
    truth = [1] * len(high) + [0] * len(low)
    assert auroc(high, low) == pytest.approx(roc_auc_score(truth, high + low))


@settings(deadline=None)  # on a busy machine any call may wait
@given(values, values)
def test_auroc_is_the_share_of_pairs_in_the_right_order(high: list[int], low: list[int]):
    wins = sum((one > other) + (one == other) / 2 for one in high for other in low)
    assert auroc(high, low) == pytest.approx(wins / len(high) / len(low))


def ranks(values: list[int]) -> list[float]:
    """Ranks from 1, ties at their mean, by counting."""
    return [
        sum(other < value for other in values) + (values.count(value) + 1) / 2 for value in values
    ]


@settings(deadline=None)  # on a busy machine any call may wait
@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=60))
def test_spearman_is_the_correlation_of_the_ranks(pairs: list[tuple[int, int]]):
    left, right = map(list, zip(*pairs, strict=True))
    if len(pairs) > 2 and len(set(left)) > 1 and len(set(right)) > 1:
        expected = np.corrcoef(ranks(left), ranks(right))[0, 1]
        assert spearman(left, right) == pytest.approx(expected)
    else:
        assert spearman(left, right) is None


def test_partial_spearman_removes_what_length_explains():
    rng = np.random.default_rng(0)
    length = rng.normal(size=4000)
    score = length + rng.normal(size=4000)
    leverage = length + rng.normal(size=4000)
    assert spearman(leverage, score) > 0.4
    assert abs(partial_spearman(leverage, score, length)) < 0.05
    direct = score + 0.1 * rng.normal(size=4000)
    assert partial_spearman(direct, score, length) > 0.9


def test_partial_spearman_is_the_correlation_of_what_length_leaves_of_the_ranks():
    rng = np.random.default_rng(1)
    columns = [rng.integers(0, 8, size=50).tolist() for _ in range(3)]
    one, other, given_ = (np.array(ranks(column)) for column in columns)

    def rest(values: np.ndarray) -> np.ndarray:
        return values - np.polyval(np.polyfit(given_, values, 1), given_)

    expected = np.corrcoef(rest(one), rest(other))[0, 1]
    assert partial_spearman(*columns) == pytest.approx(expected)


def test_partial_spearman_without_a_constant_is_spearman_and_of_the_same_thing_is_none():
    assert partial_spearman([1, 2, 3, 4], [1, 3, 2, 4], [5, 5, 5, 5]) == pytest.approx(0.8)
    assert partial_spearman([1, 2, 3, 4], [1, 3, 2, 4], [1, 2, 3, 4]) is None
    assert partial_spearman([1, 1, 1, 1], [1, 3, 2, 4], [1, 2, 3, 4]) is None


NAN = float("nan")


@pytest.mark.parametrize("infinite", [np.inf, -np.inf])
def test_infinity_has_a_rank(infinite: float):
    assert auroc([infinite], [0.0]) == (infinite > 0)
    assert spearman([infinite, 0.0, 1.0], [infinite, 0.0, 1.0]) == pytest.approx(1)


def test_nan_has_no_rank_and_is_refused_with_where_it_is():
    calls = {
        "high": lambda: auroc([0.5, NAN], [0.1]),
        "low": lambda: auroc([0.5], [0.1, NAN]),
        "values": lambda: spearman([1, NAN, 3], [1, 2, 3]),
        "others": lambda: spearman([1, 2, 3], [1, NAN, 3]),
        "given": lambda: partial_spearman([1, 2, 3], [1, 3, 2], [1, NAN, 3]),
        "leverage": lambda: find_calibration(np.array([0.5, NAN]), np.array([0.1])),
    }
    for name, call in calls.items():
        with pytest.raises(InvalidInputError, match=f"^{name}: expected numbers, found nan at row"):
            call()


def test_auroc_of_nothing_is_refused():
    with pytest.raises(InvalidInputError, match="found 0 high and 2 low ones"):
        auroc([], [0.1, 0.2])


@pytest.mark.parametrize("judge", [measure_quality, compare_with_tiers])
def test_leverage_that_is_no_number_per_pair_is_refused(
    dataset: Dataset, judge: Callable[[Dataset, np.ndarray], object]
):
    leverage = np.full(len(dataset), 0.5, np.float32)
    for row in (0, len(dataset) - 1):
        wrong = leverage.copy()
        wrong[row] = np.nan
        with pytest.raises(InvalidInputError, match=f"leverage: .*found nan at row {row}, 1 in"):
            judge(dataset, wrong)
    for wrong in (leverage[:-1], np.append(leverage, 1), leverage[:, None]):
        with pytest.raises(InvalidInputError, match="leverage: expected one number per pair, 420"):
            judge(dataset, wrong)


def test_tiers_are_ordered_and_averaged_over_unlabeled_pairs(dataset: Dataset):
    tier = dataset.per_pair("tier")
    leverage = np.select([tier == "0-25", tier == "50-75"], [0.1, 0.5], 0.8).astype(np.float32)
    leverage[dataset.per_pair("labeled").astype(bool)] = 0.0
    judged = measure_quality(dataset, leverage)
    assert list(judged.mean_leverage_by_tier) == ["0-25", "50-75", "expert"]
    assert list(judged.mean_leverage_by_tier.values()) == pytest.approx([0.1, 0.5, 0.8])
    assert judged.auroc == judged.auroc_length_matched == 1.0
    assert judged.spearman is not None
    assert judged.spearman > 0.9


def test_length_matching_is_not_fooled_by_leverage_that_grows_with_time(dataset: Dataset):
    leverage = dataset.pairs().step.astype(np.float32)
    judged = measure_quality(dataset, leverage)
    assert judged.auroc is not None
    assert judged.auroc > 0.7
    assert judged.auroc_length_matched == pytest.approx(0.5)


def test_a_dataset_without_tiers_and_scores_has_no_quality(store: Store):
    plain = store.create("plain", [drive(0, 9)], state_names=STATE_NAMES, action_names=ACTION_NAMES)
    judged = measure_quality(plain, np.ones(9, np.float32))
    assert judged.mean_leverage_by_tier == {}
    assert (judged.auroc, judged.spearman, judged.auroc_length_matched) == (None, None, None)
    assert (judged.true_expert_share, judged.true_weight_on_experts) == (None, None)
    assert judged.true_calibration_error is None


def test_the_truth_about_weights_counts_unlabeled_pairs_of_known_tier(dataset: Dataset):
    tier = dataset.per_pair("tier")
    leverage = np.select([tier == "0-25", tier == "50-75"], [0.0, 0.25], 0.75).astype(np.float32)
    leverage[dataset.per_pair("labeled").astype(bool)] = 1.0
    judged = measure_quality(dataset, leverage)
    # 150 pairs of the expert, 90 of the tier 50-75, 60 of the tier 0-25
    assert judged.true_expert_share == pytest.approx(150 / 300)
    assert judged.true_weight_on_experts == pytest.approx(0.75 * 150 / (0.75 * 150 + 0.25 * 90))
    assert judged.true_calibration_error == pytest.approx((150 * 0.25 + 90 * 0.25) / 300)
    nothing = measure_quality(dataset, np.zeros(len(dataset), np.float32))
    assert nothing.true_weight_on_experts is None
    assert nothing.true_calibration_error == pytest.approx(0.5)


def test_the_calibration_curve_of_a_dataset_is_that_of_its_tiers(dataset: Dataset):
    tier = dataset.per_pair("tier")
    curve = compare_with_tiers(dataset, (tier == "expert").astype(np.float32))
    assert curve is not None
    assert curve.leverage.tolist() == curve.expert_share.tolist() == [0, 1]
    assert curve.pairs.tolist() == [150, 150]


def test_a_dataset_without_tiers_has_no_calibration_curve(store: Store):
    plain = store.create("plain", [drive(0, 9)], state_names=STATE_NAMES, action_names=ACTION_NAMES)
    assert compare_with_tiers(plain, np.ones(9, np.float32)) is None


def of_tiers(store: Store, *tiers: str) -> Dataset:
    return store.create(
        "odd",
        [drive(0, 30, labeled=True), *(drive(1 + i, 9, tier=tier) for i, tier in enumerate(tiers))],
        state_names=STATE_NAMES,
        action_names=ACTION_NAMES,
    )


def test_only_tiers_that_begin_with_a_plain_number_are_ordered_by_it(store: Store):
    odd = of_tiers(store, "²", "expert", "٣-9", "100", "25-50", "bad", "9-10")
    judged = measure_quality(odd, np.full(len(odd), 0.5, np.float32))
    assert list(judged.mean_leverage_by_tier) == [
        "9-10",
        "25-50",
        "100",
        "bad",
        "²",
        "٣-9",
        "expert",
    ]


def test_text_that_looks_like_markup_is_shown_as_it_is(capsys: pytest.CaptureFixture[str]):
    print_table("Lap [/x]", [{"[/y]": "[/z]", "[bold]": "[red]car[/red]"}])
    out = capsys.readouterr().out
    for text in ("Lap [/x]", "[/y]", "[/z]", "[bold]", "[red]car[/red]"):
        assert text in out


def test_a_tier_of_any_name_has_its_own_column(store: Store, capsys: pytest.CaptureFixture[str]):
    score(of_tiers(store, "run", "tier run", "AUROC", "[/x]"), GPR(), run="mine")
    show("odd", location=StoreLocation(store.folder.uri))
    lines = capsys.readouterr().out.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("Mean leverage"))
    _, _, _, head, _, row, *_ = lines[first:]
    assert [cell.strip() for cell in head.strip("┃").split("┃")][:5] == [
        "run",
        "tier AUROC",
        "[/x]",
        "tier run",
        "tier tier run",
    ]
    assert row.strip("│").split("│")[0].strip() == "mine"
