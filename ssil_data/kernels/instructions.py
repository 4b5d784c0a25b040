"""LLVM instructions that its builder lacks: counted loops, vector loads and operations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir

FLOAT, DOUBLE, INDEX, POINTER = ir.FloatType(), ir.DoubleType(), ir.IntType(64), ir.PointerType()
FAST = ("fast",)
"""Lets LLVM estimate reciprocals and refine them; nothing infinite or NaN may come in."""


def fold(
    b: ir.IRBuilder, count: Any, carried: Sequence, body: Callable[[Any, Sequence], Sequence]
) -> Sequence:
    """Write `for index in range(count): carried = body(index, carried)`; return the last ones."""
    before, head = b.block, b.append_basic_block()
    b.branch(head)
    b.position_at_end(head)
    phis = [b.phi(value.type) for value in (INDEX(0), *carried)]
    for phi, value in zip(phis, (INDEX(0), *carried), strict=True):
        phi.add_incoming(value, before)
    results = body(phis[0], phis[1:])
    following = b.add(phis[0], INDEX(1))
    for phi, value in zip(phis, (following, *results), strict=True):
        phi.add_incoming(value, b.block)
    after = b.append_basic_block()
    b.cbranch(b.icmp_unsigned("<", following, count), head, after)
    b.position_at_end(after)
    return results


class Vectors:
    """Loads and constants of one vector type."""

    def __init__(self, b: ir.IRBuilder, lanes: int) -> None:
        self.b, self.lanes = b, lanes
        self.type = ir.VectorType(FLOAT, lanes)
        self.zero = ir.Constant(self.type, [0.0] * lanes)

    def __call__(self, scalar: Any) -> Any:
        """Repeat a scalar in every lane."""
        one = self.b.insert_element(ir.Constant(self.type, ir.Undefined), scalar, ir.IntType(32)(0))
        lanes = ir.Constant(ir.VectorType(ir.IntType(32), self.lanes), [0] * self.lanes)
        return self.b.shuffle_vector(one, one, lanes)

    def row(self, base: Any, row: Any, count: int) -> Sequence:
        """Load row `row` of an array with `count` vectors to a row."""
        start = at(self.b, base, self.b.mul(row, INDEX(count * self.lanes)))
        places = [at(self.b, start, INDEX(i * self.lanes)) for i in range(count)]
        return [self.b.load(place, typ=self.type, align=4) for place in places]

    def scalars(self, base: Any, row: Any, count: int) -> Sequence:
        """Load row `row` of an array with `count` numbers to a row, each repeated."""
        start = at(self.b, base, self.b.mul(row, INDEX(count)))
        places = [at(self.b, start, INDEX(i)) for i in range(count)]
        return [self(self.b.load(place, typ=FLOAT)) for place in places]


def intrinsic(
    b: ir.IRBuilder, name: str, *operands: Any, result: Any = None, fastmath: Sequence[str] = ()
) -> Any:
    """Call LLVM's vector operation `name`; its result is as its last operand unless told."""
    vector = operands[-1].type
    full_name = f"llvm.{name}.v{vector.count}f32"
    function = b.module.globals.get(full_name) or ir.Function(
        b.module,
        ir.FunctionType(result or vector, [operand.type for operand in operands]),
        full_name,
    )
    return b.call(function, operands, fastmath=fastmath)


def fmuladd(b: ir.IRBuilder, x: Any, y: Any, z: Any) -> Any:
    """Write x · y + z, fused where the host can."""
    return intrinsic(b, "fmuladd", x, y, z)


def at(b: ir.IRBuilder, base: Any, index: Any, element: Any = FLOAT) -> Any:
    """Write the address of element `index` of an array."""
    return b.gep(base, [index], source_etype=element)


def constant(vector: Any, value: float) -> Any:
    """Return a vector constant, the same in every lane."""
    return ir.Constant(vector, [value] * vector.count)
