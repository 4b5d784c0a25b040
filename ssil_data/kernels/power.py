r"""The power w = t^(−p) of a kernel as LLVM instructions: by products, or by a logarithm.

p = (α + 1)/2 is whole where α is odd: w is then 1/t, squared and multiplied. At large p that
magnifies the rounding of t and of its reciprocal v, so both are taken back, to the first order:

    t = 1 + u,   v = (1 − e) / t with e = (1 − v) − u v,   w = v^p (1 + p e)

At α = 2, w is the cube of a reciprocal square root, and for any other α, w = 2^(−p · log₂(1 + u))
with a logarithm that starts from u, too:

    1 + u = 2^e m with 2/3 ≤ m < 4/3,   f = (1 + u) 2^(−e) − 1,   log₂(1 + u) = e + f · P(f)
    2^y = 2^n · Q(y − n) with n = ⌊y + 1/2⌋

P and Q are Chebyshev interpolants, good to float32. Weights below 2^−62, whose square would
underflow, are 0.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from llvmlite import ir
from numpy.polynomial import Chebyshev, Polynomial

from ssil_data.kernels.instructions import FAST, constant, fmuladd, intrinsic

_LEAST = -62.0
_TWO_THIRDS, _ONE = 0x3F2AAAAB, 0x3F800000
_ROUNDER = 1.5 * 2.0**23
_ROUNDED, _MOST = 8, 100
"""The largest whole p at which t may be rounded, and at which products are exact enough."""


class Power(ABC):
    """How t^(−p) is computed; equal ones make equal code."""

    @property
    @abstractmethod
    def offset(self) -> float:
        """Return what its input is more than u: 0 where that is u, 1 where it is t."""

    @abstractmethod
    def __call__(self, b: Any, exponent: Any) -> Callable[[Any], Any]:
        """Return what writes w for a vector of t or u; `exponent` is the vector of p."""

    @staticmethod
    def of(alpha: float) -> Power:
        """Choose for α."""
        exponent = (alpha + 1) / 2
        if exponent in range(1, _MOST + 1):
            return Whole(int(exponent))
        return RootCubed() if alpha == 2 else General()


@dataclass(frozen=True)
class Whole(Power):
    """α odd, from 1 to 199: some ten products at most, with p written into the code."""

    exponent: int

    @property
    def offset(self) -> float:
        """Return 1 where rounding t does no harm."""
        return 1.0 if self.exponent <= _ROUNDED else 0.0

    def __call__(self, b: Any, exponent: Any) -> Callable[[Any], Any]:
        """Write the power of a reciprocal, 0 where it would be too small."""
        one, zero = constant(exponent.type, 1.0), constant(exponent.type, 0.0)
        largest = constant(exponent.type, float(np.float32(2 ** (-_LEAST / self.exponent))))

        def reciprocal(t: Any) -> Any:
            inverse = b.fdiv(one, t, flags=FAST)
            if self.exponent < 3:  # no state is so far away
                return inverse
            return b.select(b.fcmp_ordered("<", t, largest), inverse, zero)

        def correct(u: Any) -> Any:
            inverse = reciprocal(b.fadd(one, u))
            error = fmuladd(b, b.fneg(u), inverse, b.fsub(one, inverse))
            return b.fmul(self._raise_to_power(b, inverse), fmuladd(b, error, exponent, one))

        return correct if self.offset == 0 else lambda t: self._raise_to_power(b, reciprocal(t))

    def _raise_to_power(self, b: ir.IRBuilder, base: Any) -> Any:
        """Square for every binary digit of p after the first, multiply where it is 1."""
        power = base
        for digit in f"{self.exponent:b}"[1:]:
            power = b.fmul(power, power)
            power = b.fmul(power, base) if digit == "1" else power
        return power


@dataclass(frozen=True)
class RootCubed(Power):
    """α = 2."""

    @property
    def offset(self) -> float:
        """Return 1: its input is t."""
        return 1.0

    def __call__(self, b: Any, exponent: Any) -> Callable[[Any], Any]:
        """Write the cube of a reciprocal square root."""
        one = constant(exponent.type, 1.0)

        def cube(t: Any) -> Any:
            root = intrinsic(b, "sqrt", t, fastmath=FAST)
            inverse = b.fdiv(one, root, flags=FAST)
            return b.fmul(b.fmul(inverse, inverse), inverse)

        return cube


@dataclass(frozen=True)
class General(Power):
    """Any α."""

    @property
    def offset(self) -> float:
        """Return 0: its input is u."""
        return 0.0

    def __call__(self, b: Any, exponent: Any) -> Callable[[Any], Any]:
        """Write the power of 2 with a logarithm's multiple."""
        return lambda u: _exp2(b, b.fneg(b.fmul(exponent, _log2_1p(b, u))))


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
