"""Query parameters: what a route does not have is refused, and options are the library's."""

from __future__ import annotations

from dataclasses import fields

import httpx
import pytest
from pydantic import ValidationError

import ssil_data as sd
from ssil_data.field import LCoRQuery
from ssil_service.routes.parameters import CoRParameters, LCoRParameters
from ssil_service.schemas.responses import DatasetSummary, RunRecord

NAMES = {"dataset": "drives", "run": "vae", "model": "drives.vae", "job": "0" * 16}
VERSIONS = {"version": "0" * 16}


def test_every_route_refuses_a_parameter_that_it_does_not_have(shared_http: httpx.Client):
    paths = shared_http.get("openapi.json").json()["paths"]
    operations = [(path, method) for path, found in paths.items() for method in found]
    assert len(operations) > 25
    for path, method in operations:
        url = path.format(**NAMES, **VERSIONS)
        answer = shared_http.request(method, url, params={"nonsense": "1"})
        assert answer.status_code == 422, (method, path, answer.text)
        assert answer.headers["content-type"] == "application/problem+json"
        assert answer.json()["errors"] == [
            {"detail": "nonsense: no such parameter", "field": "nonsense"}
        ], (method, path)


def test_a_parameter_that_is_out_of_range_is_named(shared_http: httpx.Client):
    answer = shared_http.get("v1/datasets/drives/pairs", params={"offset": -1, "limit": 0})
    places = [fault["field"] for fault in answer.json()["errors"]]
    assert (answer.status_code, places) == (422, ["query.offset", "query.limit"])


def test_the_options_of_an_lcor_request_are_those_of_the_library():
    own = LCoRParameters.model_fields.keys() - CoRParameters.model_fields.keys() - {"sums"}
    assert own == {each.name for each in fields(LCoRQuery)}
    for each in fields(LCoRQuery):
        assert LCoRParameters.model_fields[each.name].default == each.default, each.name
    assert LCoRParameters().query() == LCoRQuery()
    given = LCoRParameters(tolerance=0.1, relative=True, seed=3)
    assert given.query() == LCoRQuery(tolerance=0.1, relative=True, seed=3)
    with pytest.raises(sd.InvalidInputError, match="not both"):
        LCoRParameters(tolerance=0.1, seconds=1.0).query()
    with pytest.raises(ValidationError, match="nonsense"):
        LCoRParameters.model_validate({"nonsense": 1})


def test_options_that_conflict_are_refused(shared_http: httpx.Client):
    for options, words in (
        ({"tolerance": 0.1, "seconds": 1.0}, "give a tolerance or seconds, not both"),
        ({"seed": 3}, "needs a tolerance or seconds"),
        ({"contributors": 2, "tolerance": 0.1}, "contributors: "),
    ):
        answer = shared_http.post(
            "v1/datasets/drives/runs/vae/lcor", params=options, json={"states": [[1, 2, 3]]}
        )
        assert (answer.status_code, words in answer.json()["detail"]) == (422, True)


def test_records_are_served_as_the_library_declares_them(shared_http: httpx.Client):
    record = shared_http.get("v1/datasets/drives/runs/vae").json()
    RunRecord.model_validate(record, strict=True)
    assert set(record) == set(RunRecord.model_fields)
    names = {"run" if each.name == "name" else each.name for each in fields(sd.Run)}
    assert set(record) == names
    summary = shared_http.get("v1/datasets/drives").json()
    DatasetSummary.model_validate(summary, strict=True)
    assert set(summary) == set(DatasetSummary.model_fields)
