"""Settings as JSON, fitted estimators as bytes."""

import json
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors

from ssil_data.demonstrations import Pairs
from ssil_data.errors import DamagedError, InvalidInputError, SsilDataError
from ssil_data.estimators import (
    ESTIMATORS,
    GPR,
    MDN,
    VAE,
    Contrast,
    Ensemble,
    Estimator,
    Fitted,
    WindowVAE,
    dump,
    from_json,
    load,
    to_json,
)


def test_settings_survive_json(estimator: Estimator):
    assert from_json(json.loads(json.dumps(to_json(estimator)))) == estimator


def test_kinds_are_the_names_of_the_estimators():
    of_the_paper = {"vae": VAE, "windowvae": WindowVAE, "mdn": MDN, "gpr": GPR}
    assert {**of_the_paper, "contrast": Contrast, "ensemble": Ensemble} == ESTIMATORS


def test_absent_settings_take_their_defaults():
    assert from_json({"kind": "vae", "latent": 3}) == VAE(latent=3)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({}, "expected one of .*, found None"),
        ({"kind": "knn"}, "found 'knn'"),
        ({"kind": ["vae"]}, r"found \['vae'\]"),
        ({"kind": "vae", "layers": 3}, r"expected keys of .*, found \['layers'\]"),
        ({"kind": "vae", "latent": "3"}, "latent: expected a whole number > 0, found '3'"),
    ],
)
def test_malformed_settings_are_refused(values: dict, message: str):
    with pytest.raises(InvalidInputError, match=message):
        from_json(values)


@pytest.mark.parametrize("wrong", [0, -1, 2.5, True, None, "8"])
def test_a_count_must_be_a_positive_whole_number(wrong: object):
    with pytest.raises(InvalidInputError, match="vae: hidden: expected a whole number > 0"):
        from_json({"kind": "vae", "hidden": wrong})


@pytest.mark.parametrize("wrong", [10**9 + 1, 2**63])
def test_a_count_has_an_end(wrong: int):
    with pytest.raises(InvalidInputError, match="> 0, at most 1,000,000,000, found"):
        from_json({"kind": "vae", "hidden": wrong})


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan"), float("inf"), True, "1"])
def test_a_weight_must_be_a_positive_finite_number(wrong: object):
    with pytest.raises(InvalidInputError, match="vae: beta: expected a finite number > 0"):
        from_json({"kind": "vae", "beta": wrong})


@pytest.mark.parametrize("wrong", [0, 1, "yes", None])
def test_a_switch_must_be_true_or_false(wrong: object):
    with pytest.raises(InvalidInputError, match="mdn: surprisal: expected true or false"):
        from_json({"kind": "mdn", "surprisal": wrong})


@pytest.mark.parametrize("data", [b"", b"\0" * 8, b"not safetensors", b"\xff" * 100])
def test_bytes_that_are_no_archive_are_refused(data: bytes):
    with pytest.raises(DamagedError, match="not the safetensors that were written"):
        load(data)


def test_safetensors_of_another_program_are_refused():
    with pytest.raises(DamagedError, match="not the safetensors that were written"):
        load(save_tensors({"weight": np.ones(3, np.float32)}))


@pytest.mark.parametrize(
    "description",
    ["", "[]", "1", '"a"', "{}", '{"settings": 1}', "[" * 100_000],
)
def test_a_malformed_description_is_refused(description: str):
    with pytest.raises(DamagedError, match="not the safetensors that were written"):
        load(save_tensors({}, metadata={"estimator": description}))


@pytest.mark.parametrize("width", ["Infinity", "null", '"a"', "-1", "1e400", "{}"])
def test_a_malformed_width_is_refused(width: str):
    description = f'{{"settings": {{"kind": "vae"}}, "state_width": {width}, "action_width": 1}}'
    with pytest.raises(DamagedError, match="vae: its arrays do not fit together"):
        load(save_tensors({}, metadata={"estimator": description}))


def test_an_archive_of_an_unknown_kind_is_refused():
    description = '{"settings": {"kind": "forest"}, "state_width": 1, "action_width": 1}'
    with pytest.raises(InvalidInputError, match="found 'forest'"):
        load(save_tensors({}, metadata={"estimator": description}))


def test_numbers_of_another_type_are_refused():
    header = b'{"a":{"dtype":"BF16","shape":[1],"data_offsets":[0,2]}}'
    with pytest.raises(DamagedError):
        load(len(header).to_bytes(8, "little") + header + b"\0\0")


def test_a_cut_archive_is_refused(fitted: Fitted):
    data = dump(fitted)
    for length in (7, 100, len(data) // 2, len(data) - 1):
        with pytest.raises(DamagedError):
            load(data[:length])


def changed(fitted: Fitted, name: str, change: Callable[[np.ndarray], np.ndarray | None]) -> bytes:
    """Return the archive with one tensor changed, or left out."""
    data = dump(fitted)
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
    tensors = load_tensors(data)
    value = change(tensors.pop(name))
    if value is not None:
        tensors[name] = value
    return save_tensors(tensors, metadata=header["__metadata__"])


@pytest.mark.parametrize(
    "change",
    [
        lambda array: None,
        lambda array: array.reshape(-1)[:-1],
        lambda array: array.astype(np.float64),
        lambda array: np.full_like(array, np.nan),
        lambda array: array[None],
    ],
    ids=["missing", "shorter", "float64", "NaN", "of another dimension"],
)
def test_every_tensor_is_checked(fitted: Fitted, change: Callable):
    for name in load_tensors(dump(fitted)):
        with pytest.raises(DamagedError):
            load(changed(fitted, name, change))


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_changed_bytes_are_refused_or_read_but_never_crash(
    fitted: Fitted, expert: Pairs, data: st.DataObject
):
    changed = bytearray(dump(fitted))
    header = 8 + int.from_bytes(changed[:8], "little")
    for _ in range(data.draw(st.integers(1, 4))):
        changed[data.draw(st.integers(0, header))] = data.draw(st.integers(0, 255))
    try:
        load(bytes(changed))
    except SsilDataError as error:
        assert str(error)
