"""The record of a scoring run: what it was made from, how, and what it takes to use it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any


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
        How many pairs were scored, and how many of them are labeled.
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

    def to_json(self) -> dict[str, Any]:
        """Return the record as it is stored and served: its name under the key `run`."""
        values = asdict(self)
        return {"run": values.pop("name"), **values}

    @classmethod
    def from_json(cls, json: Mapping[str, Any]) -> Run:
        """Read a record from `to_json`'s object.

        Parameters
        ----------
        json
            The object, with the name under the key `run`.
        """
        values = dict(json)
        return cls(name=values.pop("run"), **values)
