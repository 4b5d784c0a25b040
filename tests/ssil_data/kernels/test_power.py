"""The weight of one reference is its kernel, to float32, and nothing where it is too small."""

import numpy as np
import pytest

from ssil_data.kernels import log_kernel
from ssil_data.kernels.native import Target, compile_code
from ssil_data.kernels.panels import Panels
from ssil_data.kernels.passes import Pass
from ssil_data.kernels.power import General, Power, RootCubed, Whole
from ssil_data.kernels.products import Products


def weights(target: Target, alpha: float, distances: np.ndarray, *, direct: bool) -> np.ndarray:
    """Return w of one reference at distances (m,) from as many queries."""
    nothing = np.zeros(1, np.float32)
    panels = Panels.of(np.zeros((1, 1), np.float32), nothing, nothing, target.tile.references)
    code = compile_code(target, Power.of(alpha), Products.SUMS, direct=direct)
    queries = distances.astype(np.float32)[:, None]
    (_, once, _), _ = Pass(code, alpha, panels, 1)(queries, np.zeros(len(queries)))
    return once


@pytest.mark.parametrize("alpha", [1.0, 2.0, 3.0, 5.0, 7.5, 11.0, 15.0, 17.0, 99.0, 199.0, 201.0])
@pytest.mark.parametrize("direct", [False, True])
def test_a_weight_is_the_kernel(compiled_target: Target, alpha: float, direct: bool):
    least = np.expm1(40 * np.log(2) / ((alpha + 1) / 2)) * alpha
    distances = np.concatenate([np.linspace(0, min(least, 1e6), 999), np.zeros(1)])
    found = weights(compiled_target, alpha, distances, direct=direct)
    known = np.exp(log_kernel(distances.astype(np.float32), alpha))
    np.testing.assert_allclose(found, known, rtol=1e-5)


@pytest.mark.parametrize("alpha", [5.0, 7.5, 11.0, 17.0, 99.0, 198.0, 199.0])
def test_weights_whose_square_would_underflow_are_nothing(compiled_target: Target, alpha: float):
    logs = np.array([61, 63, 70, 130, 140]) * np.log(2) / ((alpha + 1) / 2)
    distances = np.append(np.expm1(logs) * alpha, 1e29)
    found = weights(compiled_target, alpha, distances, direct=True)
    assert found[0] == pytest.approx(2.0**-61, rel=1e-4)
    assert (found[1:] == 0).all()


def test_odd_alphas_have_whole_powers():
    assert [Power.of(alpha) for alpha in (1.0, 3.0, 11.0, 199.0)] == list(
        map(Whole, (1, 2, 6, 100))
    )
    assert Power.of(2.0) == RootCubed()
    assert {Power.of(alpha) for alpha in (0.5, 4.0, 10.999, 201.0, 1e9)} == {General()}
