"""Settings of training of another type are refused by a message that names the field.

Every field is tried, so that a setting that is added later is tried too.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from ssil_data.errors import InvalidInputError
from ssil_trainers.algorithms.config import TrainSettings

WRONG = {
    "None": None,
    "text": "x",
    "list": [],
    "truth": True,
    "nan": float("nan"),
    "inf": float("inf"),
    "huge": 10**5000,
    "fraction": 1.5,
}

FITTING = {"bool": {"truth"}, "int": set(), "float": {"fraction"}}
"""What is of a field's type; it may be out of its range."""


def list_wrong() -> Iterator[Any]:
    for field in fields(TrainSettings):
        declared = "float" if field.name == "cor_alpha" else str(field.type)
        for name, value in WRONG.items():
            if name not in FITTING.get(declared, set()):
                yield pytest.param(field.name, value, id=f"{field.name}-{name}")


@pytest.mark.parametrize(("name", "value"), list(list_wrong()))
def test_a_setting_of_another_type_is_refused_by_its_name(name: str, value: Any) -> None:
    with pytest.raises(InvalidInputError, match=rf"^{name}: expected .*found") as refused:
        TrainSettings(**{name: value})
    assert len(str(refused.value)) < 200


NUMBERS = [field.name for field in fields(TrainSettings) if field.type in ("int", "float")]


@pytest.mark.parametrize("name", [*NUMBERS, "cor_alpha"])
def test_a_number_of_numpy_is_kept_as_one_of_python(name: str) -> None:
    value = 3.0 if name == "cor_alpha" else getattr(TrainSettings(), name)
    kinds = (np.int64, np.uint32) if isinstance(value, int) else (np.float64, np.float32)
    for kind in kinds:
        kept = getattr(TrainSettings(**{name: kind(value)}), name)
        assert type(kept) is type(value)
        assert kept == kind(value)
        assert json.loads(json.dumps(kept)) == kept
    with pytest.raises(InvalidInputError, match=rf"^{name}: expected .*found"):
        TrainSettings(**{name: np.bool_(True)})


def test_a_fraction_is_no_count_even_if_it_is_whole() -> None:
    for value in (1024.0, np.float64(1024)):
        wrong: Any = value
        with pytest.raises(InvalidInputError, match=r"^steps: expected a whole number .*1024\.0"):
            TrainSettings(steps=wrong)


def test_whole_numbers_do_for_any_number() -> None:
    assert TrainSettings(kl=1, eta=0, cor_alpha=2, log_sigma=-1).eta == 0
