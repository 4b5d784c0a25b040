"""Hooks for schemathesis: which names exist and how wide a state is, as no document can say.

Without them nearly every request would end at 404 or at a width. They change names and widths
only, so that what was drawn valid stays valid and what was drawn invalid stays invalid.
"""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import schemathesis
from hypothesis import strategies as st
from schemathesis.transport.serialization import Binary

from ssil_data.client.wire import ARROW, PARQUET, encode, rows_of_matrix
from support.demonstrations import ACTION_NAMES, STATE_NAMES

STATE_WIDTH = len(STATE_NAMES)
ACTION_WIDTH = len(ACTION_NAMES)


def _table(rows: int) -> pa.Table:
    rng = np.random.default_rng(rows)
    return pa.table(
        {
            "episode": np.arange(rows) // 3,
            "step": np.arange(rows) % 3,
            "state": rows_of_matrix(rng.normal(size=(rows, STATE_WIDTH)).astype(np.float32)),
            "action": rows_of_matrix(rng.normal(size=(rows, ACTION_WIDTH)).astype(np.float32)),
        },
        metadata={"state_names": json.dumps(STATE_NAMES), "action_names": json.dumps(ACTION_NAMES)},
    )


def _parquet(rows: int) -> bytes:
    sink = pa.BufferOutputStream()
    pq.write_table(_table(rows), sink)
    return sink.getvalue().to_pybytes()


_ROWS = st.integers(1, 12)
schemathesis.openapi.media_type(ARROW, _ROWS.map(lambda n: encode(_table(n)).to_pybytes()))
schemathesis.openapi.media_type(PARQUET, _ROWS.map(_parquet))


@schemathesis.hook
def before_call(context, case, kwargs):
    """Fit a case to the store."""
    method = case.method.upper()
    path = case.operation.path
    case.path_parameters = _use_existing_names(case.path_parameters, method)
    if case.meta is not None and case.meta.generation.mode.is_negative:
        if isinstance(case.body, bytes | Binary):
            case.body = Binary(b"no table")  # of bytes, schemathesis draws valid ones only
        return
    case.query = _drop_options(
        case.query, uploads=method in ("PUT", "POST") and "/runs" not in path
    )
    case.headers.pop("Inference-Header-Content-Length", None)
    case.body = _fit_body(case.body, infers=path.endswith("/infer"))


def _use_existing_names(names, method):
    """Use names that exist, three times out of four; never delete or replace what exists."""
    if not names or method in ("DELETE", "PUT"):
        return names
    names = dict(names)
    for name, existing in (("dataset", "drives"), ("run", "vae"), ("model", "drives.vae.lcor")):
        drawn = names.get(name)
        if isinstance(drawn, str) and drawn.isascii() and drawn.isalnum() and len(drawn) % 4:
            names[name] = existing
    return names


def _drop_options(query, *, uploads):
    """Leave out what cannot be guessed (versions, columns) and options that contradict others."""
    columns = (
        "state",
        "action",
        "episode",
        "step",
        "reward",
        "position",
        "score",
        "tier",
        "labeled",
    )
    left_out = ["version", *(columns if uploads else [])]
    if "tolerance" in (query or {}):
        left_out += ["seconds", "contributors"]
    elif "seconds" in (query or {}):
        left_out += ["relative", "contributors"]
    else:
        left_out += ["relative"]
    if (query or {}).get("sums"):
        left_out += ["tolerance", "relative", "seconds", "seed"]
    return {name: value for name, value in (query or {}).items() if name not in left_out}


def _fit_body(body, *, infers):
    """Give rows the dataset's width, a model its inputs, and a recipe what no schema can say."""
    if isinstance(body, bytes):
        return Binary(body)  # a string to schemathesis, as the document says
    if not isinstance(body, dict):
        return body
    body = dict(body)
    if _is_matrix(body.get("states")):
        count = len(body["states"])
        body["states"] = [_wide(row, STATE_WIDTH) for row in body["states"]]
        if _is_matrix(body.get("actions")):
            body["actions"] = [_wide(row, ACTION_WIDTH) for row in body["actions"]][:count]
            body["actions"] += [[0.0] * ACTION_WIDTH] * (count - len(body["actions"]))
            for name, values in (("episode", [0] * count), ("step", list(range(count)))):
                if isinstance(body.get(name), list) and all(map(_is_int64, body[name])):
                    body[name] = values
    scale = body.get("scale")
    if isinstance(scale, dict) and scale.get("kind") == "quantile":
        ends = [scale.get("low", 0.05), scale.get("high", 0.95)]
        if all(map(_is_number, ends)) and min(ends) >= 0 and max(ends) <= 1:
            body["scale"] = {**scale, "low": min(ends) / 2, "high": 0.6 + max(ends) / 3}
    # self-training goes with the posterior scale alone, which an estimator does not bring along
    given = scale.get("kind") if isinstance(scale, dict) else None
    if body.get("self_training") is True and given != "posterior":
        body["self_training"] = given is None and "scale" not in body and "estimator" not in body
    if isinstance(body.get("estimator"), dict):
        body["estimator"] = _with_different_members(body["estimator"])
    if _is_number(body.get("labels")):  # a whole number may be drawn as 1e12
        body["labels"] = min(body["labels"], 120)
    if isinstance(body.get("version"), str) and len(body["version"]) == 16:
        del body["version"]
    if infers and _are_tensors(body.get("inputs")):
        body["inputs"] = [
            {
                "name": "states",
                "datatype": "FP32",
                "shape": [1, STATE_WIDTH],
                "data": [0.5] * STATE_WIDTH,
            }
        ]
        if isinstance(body.get("outputs"), list) and all(map(_is_output, body["outputs"])):
            body["outputs"] = []
    return body


def _with_different_members(estimator):
    """Give an ensemble no two members of a kind, and two at least."""
    members = estimator.get("members")
    if not isinstance(members, list) or not all(isinstance(each, dict) for each in members):
        return estimator
    kinds = {str(each.get("kind")): each for each in members}
    if len(members) < 2 or not kinds.keys() <= {"vae", "windowvae", "mdn", "gpr", "contrast"}:
        return estimator
    if len(kinds) < 2:
        kinds |= {kind: {"kind": kind} for kind in ("vae", "contrast") if kind not in kinds}
    return {**estimator, "members": list(kinds.values())}


def _wide(row, width):
    return (row * width)[:width]


def _is_matrix(rows):
    return isinstance(rows, list) and all(
        isinstance(row, list) and row and all(map(_is_float32, row)) for row in rows
    )


def _is_number(value):
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_float32(value):
    return _is_number(value) and abs(value) <= 3.4028234663852886e38


def _is_integer(value):
    return isinstance(value, int) and not isinstance(value, bool)


def _is_length(value):
    whole = _is_integer(value) or (isinstance(value, float) and value.is_integer())
    return whole and 0 <= value <= 2**40


def _is_int64(value):
    return _is_integer(value) and -(2**63) <= value < 2**63


def _are_tensors(tensors):
    return (
        isinstance(tensors, list)
        and 0 < len(tensors) <= 8
        and all(
            isinstance(tensor, dict)
            and isinstance(tensor.get("name"), str)
            and tensor.get("datatype") in ("FP32", "FP64", "INT64")
            and isinstance(tensor.get("shape"), list)
            and 1 <= len(tensor["shape"]) <= 2
            and all(map(_is_length, tensor["shape"]))
            and isinstance(tensor.get("data"), list | None)
            and isinstance(tensor.get("parameters", {}), dict)
            for tensor in tensors
        )
    )


def _is_output(output):
    return (
        isinstance(output, dict)
        and isinstance(output.get("name"), str)
        and isinstance(output.get("parameters", {}), dict)
    )
