"""LLVM instructions that llvmlite's builder lacks: counted loops, vector loads and operations.

In all of these modules `b` is the builder: it appends instructions to the function being written.
Python runs while code is written; a Python loop is an unrolled loop of the compiled code.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir

FLOAT = ir.FloatType()
DOUBLE = ir.DoubleType()
INDEX = ir.IntType(64)
POINTER = ir.PointerType()
FAST = ("fast",)
"""Lets LLVM estimate reciprocals and refine them; no operand may be infinite or NaN."""


def fold(
    b: ir.IRBuilder, count: Any, carried: Sequence, body: Callable[[Any, Sequence], Sequence]
) -> Sequence:
    """Write a loop: `for index in range(count): carried = body(index, carried)`.

    Parameters
    ----------
    b
        Builder.
    count
        LLVM integer, at least 1.
    carried
        Values before the first turn.
    body
        Writes one turn; gets the index and the carried values, returns the new ones.

    Returns
    -------
    Sequence
        The carried values after the last turn.
    """
    before = b.block
    head = b.append_basic_block()
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
        self.b = b
        self.lanes = lanes
        self.type = ir.VectorType(FLOAT, lanes)
        self.zero = ir.Constant(self.type, [0.0] * lanes)

    def __call__(self, scalar: Any) -> Any:
        """Repeat a scalar in every lane."""
        one = self.b.insert_element(ir.Constant(self.type, ir.Undefined), scalar, ir.IntType(32)(0))
        lanes = ir.Constant(ir.VectorType(ir.IntType(32), self.lanes), [0] * self.lanes)
        return self.b.shuffle_vector(one, one, lanes)

    def row(self, base: Any, row: Any, count: int) -> Sequence:
        """Load a row of an array as vectors.

        Parameters
        ----------
        base
            Address of the array.
        row
            LLVM integer: which row.
        count
            Vectors in a row.
        """
        start = at(self.b, base, self.b.mul(row, INDEX(count * self.lanes)))
        places = [at(self.b, start, INDEX(i * self.lanes)) for i in range(count)]
        return [self.b.load(place, typ=self.type, align=4) for place in places]

    def scalars(self, base: Any, row: Any, count: int) -> Sequence:
        """Load a row of an array, each of its numbers repeated in every lane of a vector.

        Parameters
        ----------
        base
            Address of the array.
        row
            LLVM integer: which row.
        count
            Numbers in a row.
        """
        start = at(self.b, base, self.b.mul(row, INDEX(count)))
        places = [at(self.b, start, INDEX(i)) for i in range(count)]
        return [self(self.b.load(place, typ=FLOAT)) for place in places]


def intrinsic(
    b: ir.IRBuilder, name: str, *operands: Any, result: Any = None, fastmath: Sequence[str] = ()
) -> Any:
    """Call a vector operation of LLVM.

    Parameters
    ----------
    b
        Builder.
    name
        Such as "maxnum", without "llvm." and without the type.
    operands
        Vectors, of which the last gives the type.
    result
        Type of the result; that of the last operand by default.
    fastmath
        LLVM's flags, such as "reassoc".
    """
    vector = operands[-1].type
    full_name = f"llvm.{name}.v{vector.count}f32"
    function = b.module.globals.get(full_name) or ir.Function(
        b.module,
        ir.FunctionType(result or vector, [operand.type for operand in operands]),
        full_name,
    )
    return b.call(function, operands, fastmath=fastmath)


def fmuladd(b: ir.IRBuilder, x: Any, y: Any, z: Any) -> Any:
    """Write x · y + z, fused where the processor can.

    Parameters
    ----------
    b
        Builder.
    x, y, z
        Vectors of one type.
    """
    return intrinsic(b, "fmuladd", x, y, z)


def at(b: ir.IRBuilder, base: Any, index: Any, element: Any = FLOAT) -> Any:
    """Write the address of an element of an array.

    Parameters
    ----------
    b
        Builder.
    base
        Address of the array.
    index
        LLVM integer: which element.
    element
        Type of the elements.
    """
    return b.gep(base, [index], source_etype=element)


def constant(vector: Any, value: float) -> Any:
    """Return a vector constant, the same in every lane.

    Parameters
    ----------
    vector
        Vector type.
    value
        The number.
    """
    return ir.Constant(vector, [value] * vector.count)
