"""Models of the inference protocol by their names: a run of a dataset, and what of it is asked.

Datasets and runs may have dots in their names: `a.b.c` is the run `b.c` of `a`, or `c` of `a.b`,
and `a.r.lcor` the field of `r`, or the run `r.lcor` itself. Where more than one of them exists, the
name is refused, unless the version tells which is meant.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ssil_data.errors import ConflictError, InvalidInputError, NotFoundError
from ssil_service.queries.catalog import Catalog, Snapshot

_KINDS = ("lcor", "cor")


@dataclass(frozen=True)
class Model:
    """A run of a dataset, what of it is asked, and the version that it was made from."""

    snapshot: Snapshot
    run: str
    kind: str
    version: str


async def find_model(catalogue: Catalog, model: str, version: str | None) -> Model:
    """Return what a name means.

    Raises NotFoundError, or ConflictError for two meanings, and for a field without a `version`
    whose run was made from an earlier one than the newest.
    """
    readings = [await _find(catalogue, *reading, version) for reading in _readings(model)]
    found = [each for each in readings if each is not None]
    if not found:
        raise NotFoundError("model: expected <dataset>.<run>, ….lcor or ….cor, found another")
    if len(found) > 1:
        names = " and ".join(f"run {each.run} of {each.snapshot.name}" for each in found[:2])
        raise ConflictError(f"model: expected a name with one meaning, found {names}")
    (only,) = found
    if only.kind and version is None:
        only.snapshot.run(only.run)  # a field is of the newest version unless one is named
    return only


def _readings(model: str) -> Iterator[tuple[str, str, str]]:
    """Give every dataset, run and kind that a name may mean."""
    base, _, last = model.rpartition(".")
    for name, kind in [(base, last), (model, "")] if last in _KINDS else [(model, "")]:
        for dot in [place for place, letter in enumerate(name) if letter == "."]:
            yield name[:dot], name[dot + 1 :], kind


async def _find(
    catalogue: Catalog, dataset: str, run: str, kind: str, version: str | None
) -> Model | None:
    """Return a model if there is one that is meant so."""
    try:
        if catalogue.lacks(dataset):
            return None
        snapshot = await catalogue.snapshot(dataset)
        made_from = snapshot.run_of_any_version(run).dataset_version
        if version not in (None, made_from):
            return None
        if version is not None:
            snapshot = await catalogue.snapshot(dataset, version)
        return Model(snapshot, run, kind, made_from)
    except (NotFoundError, InvalidInputError):
        return None
