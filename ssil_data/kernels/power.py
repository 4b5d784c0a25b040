r"""The power w = t^(−p) of a kernel as LLVM instructions: closed forms and one for any α.

p = (α + 1)/2 is 1, 3/2 and 2 for α = 1, 2, 3: a reciprocal, the cube of a reciprocal square root,
a squared reciprocal. For any other α, with u = t − 1, w = 2^(−p · log₂(1 + u)). At large α the
power magnifies every rounding of t, so the logarithm starts from u:

    1 + u = 2^e m with 2/3 ≤ m < 4/3,   f = (1 + u) 2^(−e) − 1,   log₂(1 + u) = e + f · P(f)
    2^y = 2^n · Q(y − n) with n = ⌊y + 1/2⌋

P and Q are Chebyshev interpolants, good to float32. Weights below 2^−62, whose square would
underflow, are 0.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Any

import numpy as np
from llvmlite import ir
from numpy.polynomial import Chebyshev, Polynomial

from ssil_data.kernels.instructions import FAST, constant, fmuladd, intrinsic

_LEAST = -62.0
_TWO_THIRDS, _ONE = 0x3F2AAAAB, 0x3F800000
_ROUNDER = 1.5 * 2.0**23


class Power(Enum):
    """How t^(−p) is computed, by α; `offset` is what its input t or u adds to u."""

    RECIPROCAL = "α = 1"
    ROOT_CUBED = "α = 2"
    RECIPROCAL_SQUARED = "α = 3"
    GENERAL = "any α"

    @classmethod
    def of(cls, alpha: float) -> Power:
        """Choose for α."""
        special = {1.0: cls.RECIPROCAL, 2.0: cls.ROOT_CUBED, 3.0: cls.RECIPROCAL_SQUARED}
        return special.get(alpha, cls.GENERAL)

    @property
    def offset(self) -> float:
        """Return 0 where the input is u, 1 where it is t = u + 1."""
        return 0.0 if self is Power.GENERAL else 1.0

    def __call__(self, b: Any, exponent: Any) -> Callable[[Any], Any]:
        """Return what writes w for a vector of t or u; `exponent` is the vector of p."""
        if self is Power.GENERAL:
            return lambda u: _exp2(b, b.fneg(b.fmul(exponent, _log2_1p(b, u))))
        one = constant(exponent.type, 1.0)

        def reciprocal(t: Any) -> Any:
            return b.fdiv(one, t, flags=FAST)

        def squared(t: Any) -> Any:
            inverse = reciprocal(t)
            return b.fmul(inverse, inverse)

        def cubed(t: Any) -> Any:
            root = intrinsic(b, "sqrt", t, fastmath=FAST)
            inverse = b.fdiv(one, root, flags=FAST)
            return b.fmul(b.fmul(inverse, inverse), inverse)

        return {
            Power.RECIPROCAL: reciprocal,
            Power.RECIPROCAL_SQUARED: squared,
            Power.ROOT_CUBED: cubed,
        }[self]


def _log2_1p(b: ir.IRBuilder, u: Any) -> Any:
    floats, integers = u.type, ir.VectorType(ir.IntType(32), u.type.count)
    one = constant(floats, 1.0)
    s = b.fadd(one, u)
    rest = b.fsub(u, b.fsub(s, one))
    bits = b.bitcast(s, integers)
    shift = constant(integers, 23)
    e = b.ashr(b.sub(bits, constant(integers, _TWO_THIRDS)), shift)
    scaling = b.shl(e, shift)
    m = b.bitcast(b.sub(bits, scaling), floats)
    inverse = b.bitcast(b.sub(constant(integers, _ONE), scaling), floats)
    f = fmuladd(b, rest, inverse, b.fsub(m, one))
    series = _polynomial(b, f, lambda x: np.log1p(x) / x / np.log(2), 1 / 3, 9)
    return fmuladd(b, f, series, b.sitofp(e, floats))


def _exp2(b: ir.IRBuilder, y: Any) -> Any:
    floats, integers = y.type, ir.VectorType(ir.IntType(32), y.type.count)
    rounder, least = constant(floats, _ROUNDER), constant(floats, _LEAST)
    rounded = b.fadd(y, rounder)
    g = b.fsub(y, b.fsub(rounded, rounder))
    series = _polynomial(b, g, np.exp2, 1 / 2, 6)
    n = b.shl(b.bitcast(rounded, integers), constant(integers, 23))
    power = b.bitcast(b.add(b.bitcast(series, integers), n), floats)
    return b.select(b.fcmp_ordered(">", y, least), power, constant(floats, 0.0))


def _polynomial(
    b: ir.IRBuilder, x: Any, function: Callable[[Any], Any], reach: float, degree: int
) -> Any:
    """Write the interpolant of `function` on [−reach, reach] at x, by Horner's rule."""
    fitted = Chebyshev.interpolate(function, degree, domain=(-reach, reach))
    coefficients = fitted.convert(kind=Polynomial, domain=(-1, 1)).coef
    *lower, total = (constant(x.type, float(np.float32(c))) for c in coefficients)
    for coefficient in reversed(lower):
        total = fmuladd(b, total, x, coefficient)
    return total
