"""Every kind of estimator, its settings as JSON, and the bytes that a fitted one is stored as.

The bytes are safetensors: the arrays of a fitted estimator by the dotted paths of its fields, such
as `processes.0.kernel.noise`. Nothing in them is executed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors

from ssil_data.errors import DamagedError, InvalidInputError
from ssil_data.estimators.base import Estimator, Fitted
from ssil_data.estimators.contrast import Contrast, FittedContrast
from ssil_data.estimators.ensemble import Ensemble, FittedEnsemble
from ssil_data.estimators.gpr import GPR, FittedGPR
from ssil_data.estimators.mdn import MDN, FittedMDN
from ssil_data.estimators.vae import VAE, FittedAutoencoder, WindowVAE
from ssil_data.json_kinds import show_short, split_kind

ESTIMATORS: dict[str, type[Estimator]] = {
    each.kind: each for each in (VAE, WindowVAE, MDN, GPR, Contrast, Ensemble)
}
"""Every estimator by its kind."""

_FITTED: dict[str, type[Fitted]] = {
    VAE.kind: FittedAutoencoder,
    WindowVAE.kind: FittedAutoencoder,
    MDN.kind: FittedMDN,
    GPR.kind: FittedGPR,
    Contrast.kind: FittedContrast,
    Ensemble.kind: FittedEnsemble,
}
_PLAIN = [field.name for field in fields(Fitted)]
_METADATA = "estimator"
_STORED_NAMES = {"standardizer": "standardiser"}
"""Fields that archives spell as the first version did."""
_MALFORMED = (ArithmeticError, LookupError, RecursionError, TypeError, ValueError)


def to_json(estimator: Estimator) -> dict[str, Any]:
    """Return settings as a JSON object with their `kind`; without `added` ones at their defaults.

    Parameters
    ----------
    estimator
        The settings.
    """
    settings = asdict(estimator)
    if isinstance(estimator, Ensemble):
        settings["members"] = [to_json(member) for member in estimator.members]
    for field in fields(estimator):
        if field.name in estimator.added and settings[field.name] == field.default:
            del settings[field.name]
    return {"kind": estimator.kind, **settings}


def from_json(settings: Mapping[str, Any]) -> Estimator:
    """Read settings from `to_json`'s object.

    Parameters
    ----------
    settings
        The JSON object; absent keys take their defaults.

    Returns
    -------
    Estimator
        The settings.

    Raises
    ------
    InvalidInputError
        For an unknown kind or key, or a value that does not fit.
    """
    kind, values = split_kind("estimator", ESTIMATORS, settings)
    if kind == Ensemble.kind:
        values["members"] = _read_members(values.get("members", ()))
    return ESTIMATORS[kind](**values)


def _read_members(members: Any) -> tuple[Estimator, ...]:
    """Read the settings of an ensemble's members; an ensemble among them is refused."""
    if not isinstance(members, list | tuple) or not all(
        isinstance(member, Mapping) and member.get("kind") != Ensemble.kind for member in members
    ):
        raise InvalidInputError(
            "ensemble: members: expected a list of estimators' settings, none of them an ensemble, "
            f"found {show_short(members)}"
        )
    return tuple(from_json(member) for member in members)


def dump(fitted: Fitted) -> bytes:
    """Return a fitted estimator as safetensors; settings and widths are JSON in its metadata.

    Parameters
    ----------
    fitted
        The estimator.
    """
    description = {
        "settings": to_json(fitted.settings),
        "state_width": fitted.state_width,
        "action_width": fitted.action_width,
    }
    metadata = {_METADATA: json.dumps(description, sort_keys=True)}
    return save_tensors(_flatten(fitted), metadata=metadata)


def load(data: bytes) -> Fitted:
    """Read a fitted estimator from `dump`'s bytes.

    Parameters
    ----------
    data
        The bytes, which need not be trusted.

    Returns
    -------
    Fitted
        The estimator.

    Raises
    ------
    DamagedError
        Where bytes are missing or changed.
    InvalidInputError
        For settings of a kind, or with a key, that this version does not know.
    """
    try:
        tensors = load_tensors(data)
        description = json.loads(_read_metadata(data)[_METADATA])
        settings = dict(description["settings"])
    except (SafetensorError, *_MALFORMED) as error:
        raise DamagedError(f"estimator: not the safetensors that were written: {error}") from None
    settings = from_json(settings)
    for name, tensor in tensors.items():
        if tensor.dtype != np.float32 or not np.isfinite(tensor).all():
            raise DamagedError(f"estimator: {name} is not of finite float32 numbers")
    try:
        widths = {name: int(description[name]) for name in _PLAIN if name != "settings"}
        return _rebuild(settings, tensors, widths)
    except _MALFORMED as error:
        raise DamagedError(f"{settings.kind}: its arrays do not fit together: {error}") from None


def _read_metadata(data: bytes) -> dict[str, str]:
    """Read the header, which `load_tensors` has checked but does not give back."""
    length = int.from_bytes(data[:8], "little")
    return json.loads(data[8 : 8 + length])["__metadata__"]


def _flatten(part: Any) -> dict[str, NDArray]:
    """Name the arrays in arrays, tuples and dataclasses of arrays by their dotted paths."""
    if isinstance(part, np.ndarray):
        return {"": np.asarray(part, order="C")}
    if isinstance(part, tuple):
        children = {str(index): child for index, child in enumerate(part)}
    else:
        names = [field.name for field in fields(part) if field.name not in _PLAIN]
        children = {_STORED_NAMES.get(name, name): getattr(part, name) for name in names}
    return {
        f"{name}.{path}".rstrip("."): array
        for name, child in children.items()
        for path, array in _flatten(child).items()
    }


def _rebuild(settings: Estimator, tensors: Mapping[str, NDArray], widths: Any) -> Fitted:
    """Rebuild a fitted estimator, and those that it is made of, from arrays."""
    known: dict[str, Any] = {"settings": settings, **widths}
    if isinstance(settings, Ensemble):
        known["members"] = tuple(
            _rebuild(member, _below(f"members.{index}.", tensors), widths)
            for index, member in enumerate(settings.members)
        )
    return _unflatten(_FITTED[settings.kind], tensors, **known)


def _below(prefix: str, tensors: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """Return the arrays whose paths begin with a prefix, by the rest of their paths."""
    return {
        path.removeprefix(prefix): array
        for path, array in tensors.items()
        if path.startswith(prefix)
    }


def _unflatten(kind: Any, tensors: Mapping[str, NDArray], **known: Any) -> Any:
    """Undo `_flatten` for a part of a type, some of whose fields are known."""
    if get_origin(kind) is np.ndarray:
        return tensors[""]
    children: dict[str, dict[str, NDArray]] = {}
    for path, array in tensors.items():
        name, _, rest = path.partition(".")
        children.setdefault(name, {})[rest] = array
    if get_origin(kind) is tuple:
        element, _ = get_args(kind)
        return tuple(_unflatten(element, children[str(index)]) for index in range(len(children)))
    hints = get_type_hints(kind)
    names = [field.name for field in fields(kind) if field.name not in known]
    parts = {
        name: _unflatten(hints[name], children[_STORED_NAMES.get(name, name)]) for name in names
    }
    return kind(**known, **parts)
