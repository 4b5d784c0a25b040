"""The regression estimate is the textbook's, and its half-width has every part that it names."""

from dataclasses import replace

import numpy as np
import pytest

from ssil_data.kernels.estimates import Estimate
from ssil_data.kernels.formulas import log_kernel
from ssil_data.kernels.moments import Population, SampleMoments
from ssil_data.kernels.regression import estimate
from ssil_data.kernels.totals import DistanceSums
from support.kernel_references import draw_references

ALPHA, COUNT, SIZE = 2.0, 8_000, 2_000
NONE = np.zeros(3)


def world() -> tuple[np.ndarray, np.ndarray, SampleMoments, DistanceSums, Population]:
    """Return all distances (3, N), leverages, and what the estimate is given of them."""
    (states, leverage), (queries, _) = draw_references(0, COUNT, 5), draw_references(1, 3, 5)
    distance = np.abs(states.astype(float)[None] - queries.astype(float)[:, None]).sum(axis=2)
    population = Population.of(leverage)
    center = distance.mean(axis=1, keepdims=True)
    u = ((distance - center) / (ALPHA + center))[:, :SIZE]
    w = (1 + u) ** (-(ALPHA + 1) / 2)
    powers = (leverage.astype(float) - population.mean)[:SIZE, None] ** np.arange(3)
    products = np.stack([x @ powers for x in (u, u * u, w, w * u, w * w)])
    moments = SampleMoments(powers.sum(axis=0), products.transpose(0, 2, 1).reshape(15, -1))
    totals = DistanceSums(distance.sum(axis=1), distance @ leverage.astype(float), NONE, NONE)
    return distance, leverage.astype(float), moments, totals, population


def textbook(distance: np.ndarray, leverage: np.ndarray) -> tuple[float, float]:
    """Return ratio and standard deviation by least squares, row by row (Cochran, chapter 7)."""
    lam = leverage - np.float32(leverage.astype(np.float32).mean(dtype=np.float64))
    features = np.stack([np.ones(COUNT), lam, distance, lam * distance], axis=1)
    kernel = np.exp(log_kernel(distance, ALPHA))
    sample, totals = features[:SIZE], features.sum(axis=0)

    def total(of: np.ndarray) -> float:
        return float(totals @ np.linalg.lstsq(sample, of[:SIZE], rcond=None)[0])

    ratio = total(lam * kernel) / total(kernel)
    error = (lam - ratio) * kernel
    fitted = sample @ np.linalg.lstsq(sample, error[:SIZE], rcond=None)[0]
    variance = ((error[:SIZE] - fitted) ** 2).sum() / (SIZE - 4)
    deviation = COUNT * np.sqrt((1 - SIZE / COUNT) * variance / SIZE) / total(kernel)
    return ratio + float(leverage.astype(np.float32).mean(dtype=np.float64)), deviation


def test_the_estimate_and_its_deviation_are_the_textbooks():
    distance, leverage, moments, totals, population = world()
    found = estimate(moments, totals, population, ALPHA)
    for i in range(3):
        value, deviation = textbook(distance[i], leverage)
        assert found.values[i] == pytest.approx(value, abs=1e-7)
        assert found.deviation[i] == pytest.approx(deviation, rel=1e-4)


def test_the_half_width_covers_what_the_totals_may_be_off():
    distance, leverage, moments, totals, population = world()
    kernel = np.exp(log_kernel(distance, ALPHA))
    known = kernel @ leverage / kernel.sum(axis=1)
    off = 0.02 * totals.plain
    moved = replace(totals, plain=totals.plain + off, plain_error=off)
    found = estimate(moments, moved, population, ALPHA)
    silent = estimate(moments, replace(moved, plain_error=NONE), population, ALPHA)
    assert (np.abs(silent.values - known) > silent.half_width).all()
    assert (np.abs(found.values - known) <= found.half_width).all()


def made_estimate(**changes: float) -> Estimate:
    usual = {
        "values": 0.5,
        "deviation": 1e-3,
        "floor": 1e-4,
        "effective_sample_size": 1e4,
        "support": 4096.0,
        "influence": 1e-3,
    }
    return Estimate(**{name: np.array([value]) for name, value in (usual | changes).items()})


@pytest.mark.parametrize(
    ("changes", "trusted"),
    [
        ({}, True),
        ({"support": 511.0}, False),
        ({"support": 513.0}, True),
        ({"influence": 0.11}, False),
        ({"influence": 0.09}, True),
    ],
)
def test_answers_that_few_references_decide_are_not_trusted(changes: dict, trusted: bool):
    assert made_estimate(**changes).is_trusted.tolist() == [trusted]
    need = made_estimate(**changes).find_size(1.0, 8192, 10**7)
    assert (need <= 8192).tolist() == [trusted]


def test_the_size_that_is_needed_reaches_the_tolerance():
    now = made_estimate()
    (need,) = now.find_size(1e-3, 8192, 10**7)
    shrunk = 1e-3 * np.sqrt((1 / need - 1e-7) / (1 / 8192 - 1e-7))
    assert 3.2905 * shrunk + 1e-4 == pytest.approx(1e-3)
    assert now.find_size(1e-2, 8192, 10**7) <= 8192
    assert made_estimate(floor=0.01).find_size(1e-3, 8192, 10**7) >= 10**7
    (supported,) = made_estimate(support=128.0).find_size(1.0, 8192, 10**7)
    assert supported == pytest.approx(4 * 8192)
