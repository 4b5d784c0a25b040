"""Models of the inference protocol by their names: a run of a dataset, and what it computes.

Datasets and runs may have dots in their names: `a.b.c` is the run `b.c` of `a`, or `c` of `a.b`,
and `a.r.lcor` the field of `r`, or the run `r.lcor` itself. If more than one of them exists, the
name is refused, unless the version tells which one is meant.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ssil_data.errors import ConflictError, InvalidInputError, NotFoundError
from ssil_service.queries.catalog import Catalog
from ssil_service.queries.snapshot import Snapshot

_KINDS = ("lcor", "cor")


@dataclass(frozen=True)
class Model:
    """A run of a dataset, and what it computes.

    Attributes
    ----------
    snapshot
        The dataset.
    run
        The run's name.
    kind
        "lcor" or "cor" of states, or "" for uncertainty and leverage of state-action pairs.
    version
        Fingerprint of the dataset's version that the run was made from.
    """

    snapshot: Snapshot
    run: str
    kind: str
    version: str


async def find_model(catalog: Catalog, model: str, version: str | None) -> Model:
    """Find what a name means.

    Parameters
    ----------
    catalog
        The datasets.
    model
        `<dataset>.<run>`, `<dataset>.<run>.lcor` or `<dataset>.<run>.cor`.
    version
        Only runs made from the version of this fingerprint; None for all.

    Returns
    -------
    Model
        The only one that the name may mean.

    Raises
    ------
    NotFoundError
        If there is none.
    ConflictError
        If there are two, and for LCoR and CoR without a version if the run was made from an
        earlier version than the newest.
    """
    readings = [await _find(catalog, *reading, version) for reading in _readings(model)]
    found = [each for each in readings if each is not None]
    if not found:
        raise NotFoundError(
            "model: none of this name; models are <dataset>.<run>, <dataset>.<run>.lcor and "
            "<dataset>.<run>.cor"
        )
    if len(found) > 1:
        names = " and ".join(f"run {each.run} of {each.snapshot.name}" for each in found[:2])
        raise ConflictError(f"model: the name may mean {names}; name a version")
    (only,) = found
    if only.kind and version is None:
        only.snapshot.check_run(only.run)  # without a version, fields are of the newest one
    return only


def _readings(model: str) -> Iterator[tuple[str, str, str]]:
    """Give every dataset, run and kind that a name may mean."""
    base, _, last = model.rpartition(".")
    for name, kind in [(base, last), (model, "")] if last in _KINDS else [(model, "")]:
        for dot in [place for place, letter in enumerate(name) if letter == "."]:
            yield name[:dot], name[dot + 1 :], kind


async def _find(
    catalog: Catalog, dataset: str, run: str, kind: str, version: str | None
) -> Model | None:
    """Return a model of exactly this dataset and run, None if there is none."""
    try:
        if catalog.lacks(dataset):
            return None
        snapshot = await catalog.snapshot(dataset)
        made_from = snapshot.run_of_any_version(run).dataset_version
        if version not in (None, made_from):
            return None
        if version is not None:
            snapshot = await catalog.snapshot(dataset, version)
        return Model(snapshot, run, kind, made_from)
    except (NotFoundError, InvalidInputError):
        return None
