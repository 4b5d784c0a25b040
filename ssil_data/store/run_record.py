"""The record of a scoring run: what it was made from, how, and what it takes to use it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

UNCHECKED = "unchecked"
"""What stands for the held-out AUROC of a run that judged no labeled pairs which it held out."""


@dataclass(frozen=True)
class Run:
    """The record of one scoring run, stored beside its model and its values.

    Parameters
    ----------
    name
        Unique in the dataset, over all its versions.
    dataset, dataset_version
        What was scored; the values belong to this version alone, the model may be used for any.
    estimator
        Settings of the estimator, a JSON object with its `kind`.
    preset
        Name of the preset whose choices it was made by, None for any other.
    scale
        Settings of the scale, a JSON object with its `kind`.
    fitted_scale
        The scale as fitted, likewise.
    labeled_is_one
        Whether labeled pairs got leverage 1 whatever their uncertainty.
    seed
        Of the fit.
    pairs, labeled
        How many pairs were scored, and how many labeled ones it rests on.
    seconds
        How long it took.
    alpha
        Sharpness of the LCoR kernel chosen for the dataset's states.
    shift, spread
        Mean and deviation of each state dimension over all pairs, (d,): they standardize states.
    created
        When, ISO 8601, UTC.
    ssil_data
        Version of the code.
    model
        Digest of the fitted estimator's bytes.
    pooling, fitted_pooling
        How uncertainty was pooled over time, and as fitted; JSON objects with their `kind`.
    scale_floor
        Least scale of a dimension, as a share of its deviation among the unlabeled pairs.
    cross_fit
        Whether labeled pairs were judged by estimators that were not fitted on them.
    self_training
        Whether the estimator was to be fitted again with the purest unlabeled pairs.
    self_trained
        How many unlabeled pairs joined the labeled ones so; 0 if they were not pure enough.
    labeled_episodes, laps
        Episodes that the labeled pairs are of, and laps of a closed road that they cover; None
        where that is not known.
    expert_share, expert_share_interval, effective_pairs, weight_on_experts
        What the leverage says of the unlabeled pairs: see `scoring.health.Health`.
    calibration_error, held_out_auroc
        What labeled pairs that were held out say of the leverage; None without them.
    weak
        Reasons not to trust the run.

    Examples
    --------
    >>> run = dataset.runs["vae"]
    >>> run.name, run.estimator["kind"], run.pairs == len(dataset)
    ('vae', 'vae', True)
    """

    name: str
    dataset: str
    dataset_version: str
    estimator: Mapping[str, Any]
    preset: str | None
    scale: Mapping[str, Any]
    fitted_scale: Mapping[str, Any]
    labeled_is_one: bool
    seed: int
    pairs: int
    labeled: int
    seconds: float
    alpha: float
    shift: Sequence[float]
    spread: Sequence[float]
    created: str
    ssil_data: str
    model: str
    pooling: Mapping[str, Any] = field(default_factory=lambda: {"kind": "none"})
    fitted_pooling: Mapping[str, Any] = field(default_factory=lambda: {"kind": "none"})
    scale_floor: float = 0.0
    cross_fit: bool = False
    self_training: bool = False
    self_trained: int = 0
    labeled_episodes: int | None = None
    laps: float | None = None
    expert_share: float | None = None
    expert_share_interval: Sequence[float] | None = None
    effective_pairs: float | None = None
    weight_on_experts: float | None = None
    calibration_error: float | None = None
    held_out_auroc: float | None = None
    weak: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Keep what a run says of itself as tuples, so that a record that was read is the same."""
        object.__setattr__(self, "weak", tuple(self.weak))
        if self.expert_share_interval is not None:
            object.__setattr__(self, "expert_share_interval", tuple(self.expert_share_interval))

    def to_json(self) -> dict[str, Any]:
        """Return the record as it is stored and served: its name under the key `run`."""
        values = asdict(self)
        values["weak"] = list(self.weak)
        if self.expert_share_interval is not None:
            values["expert_share_interval"] = list(self.expert_share_interval)
        return {"run": values.pop("name"), **values}

    @classmethod
    def from_json(cls, json: Mapping[str, Any]) -> Run:
        """Read a record from `to_json`'s object; those of earlier versions have fewer keys.

        Parameters
        ----------
        json
            The object, with the name under the key `run`.
        """
        values = dict(json)
        for name in ("expert_share_interval", "weak"):
            if values.get(name) is not None:
                values[name] = tuple(values[name])
        return cls(name=values.pop("run"), **values)


def find_misfit(run: Run) -> str:
    """Name the first field of a record that is not what it is declared as; "" for none.

    Parameters
    ----------
    run
        As read from a file that anybody may have written.
    """
    hints = get_type_hints(Run)
    wrong = (
        each.name for each in fields(run) if not _fits(getattr(run, each.name), hints[each.name])
    )
    return next(wrong, "")


def _fits(value: object, hint: Any) -> bool:
    if get_origin(hint) is UnionType:
        return any(_fits(value, choice) for choice in get_args(hint))
    if hint is NoneType:
        return value is None
    if hint is float:
        return type(value) in (int, float) and math.isfinite(value)  # pyright: ignore
    if get_origin(hint) is Mapping:
        return isinstance(value, dict)
    if get_origin(hint) is Sequence:
        (each,) = get_args(hint)
        return isinstance(value, list | tuple) and all(_fits(part, each) for part in value)
    return type(value) is hint
