r"""The power w = t^(−p) of the kernel as LLVM instructions: by products, or by a logarithm.

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

_MIN_LOG2_WEIGHT = -62.0
_TWO_THIRDS = 0x3F2AAAAB
_ONE = 0x3F800000
"""The bits of 2/3 and of 1 as float32."""
_ROUNDER = 1.5 * 2.0**23
"""Adding it to a small float32 and subtracting it again rounds to a whole number."""
_MAX_ROUNDED = 8
"""Largest whole p at which t may be rounded."""
_MAX_WHOLE = 100
"""Largest whole p at which products are exact enough."""


class Power(ABC):
    """How t^(−p) is computed; equal ones write equal code.

    Called with a builder and the vector of p, it returns a function that writes w for a vector of
    its input: t, or u = t − 1 where t would be too coarse.
    """

    @property
    @abstractmethod
    def offset(self) -> float:
        """What the input exceeds u by: 0 where it is u, 1 where it is t."""

    @abstractmethod
    def __call__(self, b: Any, exponent: Any) -> Callable[[Any], Any]:
        """Return a function that writes w for a vector of t or u; `exponent` is the vector of p."""

    @staticmethod
    def of(alpha: float) -> Power:
        """Return the quickest way that is exact enough.

        Parameters
        ----------
        alpha
            Sharpness of the kernel, > 0.
        """
        exponent = (alpha + 1) / 2
        if exponent in range(1, _MAX_WHOLE + 1):
            return Whole(int(exponent))
        return RootCubed() if alpha == 2 else General()


@dataclass(frozen=True)
class Whole(Power):
    """α odd, from 1 to 199: some ten products at most, with p written into the code."""

    exponent: int

    @property
    def offset(self) -> float:
        """1 where rounding t does no harm."""
        return 1.0 if self.exponent <= _MAX_ROUNDED else 0.0

    def __call__(self, b: Any, exponent: Any) -> Callable[[Any], Any]:
        """Write the power of a reciprocal, 0 where it would be too small."""
        one = constant(exponent.type, 1.0)
        zero = constant(exponent.type, 0.0)
        largest = constant(
            exponent.type, float(np.float32(2 ** (-_MIN_LOG2_WEIGHT / self.exponent)))
        )

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
        """1: the input is t."""
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
        """0: the input is u."""
        return 0.0

    def __call__(self, b: Any, exponent: Any) -> Callable[[Any], Any]:
        """Write the power of 2 with a logarithm's multiple."""
        return lambda u: _exp2(b, b.fneg(b.fmul(exponent, _log2_1p(b, u))))


def _log2_1p(b: ir.IRBuilder, u: Any) -> Any:
    """Write log₂(1 + u) = e + f · P(f), see the head of this module."""
    floats = u.type
    integers = ir.VectorType(ir.IntType(32), u.type.count)
    one = constant(floats, 1.0)
    s = b.fadd(one, u)
    # what rounding 1 + u lost; it goes into f, scaled
    rest = b.fsub(u, b.fsub(s, one))
    # e from the exponent bits of s, so that m = s · 2^(−e) is from 2/3 to 4/3
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
    """Write 2^y = 2^n · Q(y − n), 0 where it would be too small."""
    floats = y.type
    integers = ir.VectorType(ir.IntType(32), y.type.count)
    rounder = constant(floats, _ROUNDER)
    least = constant(floats, _MIN_LOG2_WEIGHT)
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
