"""Settings of training of another type are refused by a message that names the field.

Every field is tried, so that a setting that is added later is tried too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

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


def test_whole_numbers_do_for_any_number() -> None:
    assert TrainSettings(kl=1, eta=0, cor_alpha=2, log_sigma=-1).eta == 0
