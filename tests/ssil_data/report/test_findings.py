"""The least trusted segments have their reason, and the most disputed come first."""

from dataclasses import replace

import numpy as np
import pytest

from ssil_data.demonstrations import Episode
from ssil_data.estimators import GPR, VAE
from ssil_data.report.evidence import Evidence
from ssil_data.report.findings import find_disputes, find_least_trusted
from ssil_data.scoring import score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from support.demonstrations import drive
from support.report_page import create_plain, silent

QUICK = VAE(steps=20)


def test_the_reason_names_the_dimension_that_was_tampered_with(store: Store):
    stuck = drive(5, 90)
    states = stuck.states.copy()
    states[40:60, 1] += 50.0
    tampered = Episode(states, stuck.actions)
    dataset = create_plain(
        store, [drive(1, 90, labeled=True), drive(2, 90, labeled=True), tampered]
    )
    score(dataset, VAE(steps=300), run="vae")
    score(dataset, GPR(), run="gpr")
    found = find_least_trusted(Evidence.of(dataset, silent), silent)
    vae, gpr = found["r0"][0], found["r1"][0]
    for one in (vae, gpr):
        assert (one.segment.episode, one.segment.first, one.segment.last) == (2, 40, 59)
        speed = one.reason.dimensions[0]
        assert (speed.name, speed.unusual) == ("speed", True)
        assert speed.value == pytest.approx(float(states[40:60, 1].mean()))
    assert vae.reason.parts == {}
    assert vae.reason.dimensions[0].share is not None
    assert vae.reason.dimensions[0].share > 0.5
    assert sum(gpr.reason.parts.values()) == pytest.approx(1)


def test_planted_disagreement_comes_first(dataset: Dataset):
    for run in ("one", "two"):
        score(dataset, QUICK, run=run)
    evidence = Evidence.of(dataset, silent)
    leverage = np.linspace(0, 0.5, len(dataset), dtype=np.float32)
    other = leverage.copy()
    other[125:145] = 1.0
    one, two = evidence.runs
    planted = replace(
        evidence, runs=[replace(one, leverage=leverage), replace(two, leverage=other)]
    )
    matrix, found = find_disputes(planted)
    assert matrix.shape == (2, 2)
    assert 0.5 < matrix[0, 1] < 1
    first = found[0]
    assert (first.segment.episode, first.segment.first, first.segment.last) == (2, 5, 24)
    assert first.standings[1] > 0.8 > 0.2 > first.standings[0]
