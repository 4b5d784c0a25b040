"""Settings of another type are refused by one message that names the field and what it should be.

Every field of every kind is tried, so that a setting that is added later is tried too.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from typing import Any, get_type_hints

import numpy as np
import pytest

import ssil_data as sd
from ssil_data import pooling, scales
from ssil_data.client import RetryPolicy
from ssil_data.errors import InvalidInputError
from ssil_data.estimators import ESTIMATORS
from ssil_data.pooling.kinds import FITTED as FITTED_POOLING_KINDS
from ssil_data.pooling.window import FittedWindow
from ssil_data.ranks import KNOTS

UNCERTAINTY = np.linspace(0, 1, 200)
EPISODE = np.repeat([0, 1], 100)

FITTED_SCALES = [
    each.fit(UNCERTAINTY, UNCERTAINTY[:50])
    for each in (sd.MinMax(), sd.Conformal(), sd.Posterior())
]
FITTED_POOLINGS = [each().fit(UNCERTAINTY, EPISODE) for each in pooling.POOLINGS.values()]

VALID = [
    *(kind() for kind in (*ESTIMATORS.values(), *scales.SCALES.values())),
    *(kind() for kind in pooling.POOLINGS.values()),
    *FITTED_SCALES,
    *FITTED_POOLINGS,
    sd.preset("default"),
    RetryPolicy(),
]
"""One of every kind of settings and of fitted values."""

WRONG = {
    "None": None,
    "text": "x",
    "list": [],
    "truth": True,
    "nan": float("nan"),
    "inf": float("inf"),
    "huge": 10**5000,
    "fraction": 1.5,
    "texts": ["x"],
    "object": object(),
}

PERMITTED: dict[object, set[str]] = {
    bool: {"truth"},
    int: set(),
    float: {"fraction"},
    float | None: {"None"},
    Sequence[float]: {"list"},  # another message says that they do not fit each other
    tuple[float, ...]: {"list"},
    "members": {"list"},  # then those that measured best are taken
    # seconds may be infinitely many, and more than a float has
    "seconds": {"inf", "huge", "fraction"},
}
"""What fits a field, by its type or its name."""


def list_wrong() -> Iterator[Any]:
    for valid in VALID:
        hints = get_type_hints(type(valid))
        for field in fields(valid):
            known = "seconds" if isinstance(valid, RetryPolicy) else hints[field.name]
            known = "members" if field.name == "members" else known
            kind = known if known in PERMITTED else None
            for name, value in WRONG.items():
                if kind is not None and name in PERMITTED[kind]:
                    continue
                label = f"{type(valid).__name__}-{field.name}-{name}"
                yield pytest.param(valid, field.name, value, id=label)


@pytest.mark.parametrize(("valid", "name", "value"), list(list_wrong()))
def test_a_setting_of_another_type_is_refused_by_its_name(valid: Any, name: str, value: object):
    with pytest.raises(InvalidInputError, match=rf"(?s)\b{name}: expected .*found") as refused:
        replace(valid, **{name: value})
    assert len(str(refused.value)) < 400


def list_numbers() -> Iterator[Any]:
    for valid in VALID:
        for field in fields(valid):
            value = getattr(valid, field.name)
            if isinstance(value, int | float) and not isinstance(value, bool):
                label = f"{type(valid).__name__}-{field.name}"
                yield pytest.param(valid, field.name, value, id=label)


@pytest.mark.parametrize(("valid", "name", "value"), list(list_numbers()))
def test_a_number_of_numpy_is_kept_as_one_of_python(valid: Any, name: str, value: float):
    whole = isinstance(value, int)
    kinds = (np.int64, np.uint32) if whole else (np.float64, np.float32)
    for kind in kinds:
        given = kind(value)
        kept = getattr(replace(valid, **{name: given}), name)
        assert type(kept) is type(value)
        assert kept == given
        assert json.loads(json.dumps(kept)) == kept
    wrong = (np.bool_(True), np.str_("x"), *((np.float64(1.5),) if whole else ()))
    for given in (*wrong, *(() if isinstance(valid, RetryPolicy) else (np.float32(np.nan),))):
        with pytest.raises(InvalidInputError, match=rf"(?s)\b{name}: expected .*found"):
            replace(valid, **{name: given})


def test_a_share_of_numpy_is_kept_as_a_number_of_python():
    share = sd.Posterior(np.float32(0.05)).expert_share  # pyright: ignore[reportArgumentType]
    assert type(share) is float and share == np.float32(0.05)
    for given in (np.bool_(True), np.float32(np.nan), np.int64(2)):
        wrong: Any = given
        with pytest.raises(InvalidInputError, match="expert_share: expected 0 < share < 1"):
            sd.Posterior(wrong)


def test_sequences_of_numbers_of_numpy_are_kept_as_numbers_of_python():
    knots = np.linspace(0, 1, KNOTS, dtype=np.float32)
    window = FittedWindow(25, list(knots))  # pyright: ignore[reportArgumentType]
    assert json.loads(json.dumps(window.knots)) == list(window.knots)
    assert window == FittedWindow(25, knots.tolist())


def test_a_seed_and_labels_of_numpy_make_a_run_that_is_read_again(dataset: sd.Dataset):
    seed: Any = np.int64(3)
    labels: Any = np.int32(50)
    run = sd.score(dataset, sd.VAE(steps=20), seed=seed, labels=labels, run="numpy")
    assert (dataset.runs["numpy"].seed, run.labeled) == (3, 50)


def test_every_kind_of_settings_and_fitted_values_is_tried():
    tried = {type(valid) for valid in VALID}
    kinds = (ESTIMATORS, scales.SCALES, scales.FITTED, pooling.POOLINGS, FITTED_POOLING_KINDS)
    for known in kinds:
        assert set(known.values()) <= tried


@pytest.mark.parametrize("kind", sorted(ESTIMATORS))
def test_a_seed_that_is_none_is_refused(kind: str, dataset: sd.Dataset):
    labeled = dataset.labeled()
    unlabeled = sd.UnlabeledSample.of(dataset.pairs()[120:])
    wrong: list[Any] = [None, "x", [], True, float("nan"), 1.5, -1, 2**63]
    for seed in wrong:
        with pytest.raises(InvalidInputError, match=r"seed: expected a whole number from 0 "):
            ESTIMATORS[kind]().fit(labeled, seed=seed, unlabeled=unlabeled)


@pytest.mark.parametrize("wrong", ["x", None, {}, [["x"]]], ids=str)
@pytest.mark.parametrize("kind", [sd.MinMax, sd.Quantile, sd.Posterior])
def test_uncertainty_that_is_no_numbers_is_refused(kind: type[Any], wrong: Any):
    with pytest.raises(InvalidInputError, match=r"uncertainty: expected "):
        kind().fit(wrong)
    with pytest.raises(InvalidInputError, match=r"uncertainty: expected "):
        kind().fit(UNCERTAINTY, UNCERTAINTY[:50])(wrong)


@pytest.mark.parametrize("wrong", ["x", [], {}, 5, True], ids=str)
def test_a_name_of_no_kind_is_refused(wrong: Any):
    recipe = sd.preset("default")
    calls = {
        "preset": lambda: sd.preset(wrong, "vae"),
        "estimator": lambda: sd.preset("default", wrong),
        "scale": lambda: recipe.with_options(scale=wrong),
        "pooling": lambda: recipe.with_options(pooling=wrong),
    }
    for name, call in calls.items():
        with pytest.raises(InvalidInputError, match=rf"^{name}: expected one of \[.*found"):
            call()
