r"""The inner loops of LCoR's sums as LLVM instructions, for any vector width; it knows no host.

|a − b| = 2 max(a, b) − a − b, so that a distance takes two instructions per dimension, not three:

    ‖q − x‖₁ = 2 (Σ_i max(q_i, x_i) − Σ_i x_i / 2) − Σ_i q_i

The bracket is what a tile accumulates, for a few queries times a few vectors of references held in
registers. One multiplication and addition per pair then turns it into t = (α + d) / (α + d₀), or
into u = t − 1, and w = t^(−p) with p = (α + 1)/2 is the kernel relative to that at a distance d₀
of the query's own choice. Far from the origin, where the sums cancel, |q_i − x_i| is added up
directly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from llvmlite import ir

from ssil_data.kernels.power import FAST, Power, fmuladd, intrinsic

FLOAT, DOUBLE, INDEX, POINTER = ir.FloatType(), ir.DoubleType(), ir.IntType(64), ir.PointerType()
BLOCK = 1024
"""References that all queries of a call pass before the next ones: they stay in the cache."""


@dataclass(frozen=True)
class Tile:
    """What registers hold at a time: `queries` × `vectors` vectors of `lanes` references each."""

    lanes: int
    vectors: int
    queries: int

    @property
    def references(self) -> int:
        """Return how many references make a panel, the unit of packing."""
        return self.lanes * self.vectors


def emit(tile: Tile, power: Power, *, direct: bool) -> str:
    """Return the text of `sums(panels, queries, sums, nearest, width, panels, tiles, p)`.

    panels (·, width + 2, references) float32: the dimensions, −Σx/2, leverage. queries (tiles,
    width + 2, queries) float32: the dimensions, factor and offset of t. sums (tiles, 3, queries)
    float64, added to: Σ l w, Σ w, Σ w². nearest (tiles, panels, queries) float32: the smallest
    bracket. Every count is at least 1.
    """
    module = ir.Module()
    signature = ir.FunctionType(ir.VoidType(), [POINTER] * 4 + [INDEX] * 3 + [FLOAT])
    function = ir.Function(module, signature, "sums")
    b = ir.IRBuilder(function.append_basic_block())
    panels, queries, sums, nearest, width, panel_count, tiles, exponent = function.args
    splat = _Vectors(b, tile.lanes)
    weight = power(b, splat(exponent))
    panel_size = b.mul(b.add(width, INDEX(2)), INDEX(tile.references))
    tile_size = b.mul(b.add(width, INDEX(2)), INDEX(tile.queries))
    per_block = INDEX(BLOCK // tile.references)

    def block(index: Any, _: Sequence) -> Sequence:
        first = b.mul(index, per_block)
        left = b.sub(panel_count, first)
        count = b.select(b.icmp_unsigned("<", left, per_block), left, per_block)

        def of_tile(index: Any, _: Sequence) -> Sequence:
            query = _at(b, queries, b.mul(index, tile_size))
            minima = b.add(b.mul(index, panel_count), first)

            def panel(step: Any, totals: Sequence) -> Sequence:
                reference = _at(b, panels, b.mul(b.add(first, step), panel_size))
                brackets = _brackets(b, splat, tile, query, reference, width, direct=direct)
                smallest = _at(b, nearest, b.mul(b.add(minima, step), INDEX(tile.queries)))
                _store_minima(b, tile, brackets, smallest)
                return _weighed(b, splat, tile, brackets, query, reference, width, weight, totals)

            zeros = [splat.zero] * (3 * tile.queries)
            totals = _fold(b, count, zeros, panel)
            _add_totals(b, totals, _at(b, sums, b.mul(index, INDEX(3 * tile.queries)), DOUBLE))
            return []

        return _fold(b, tiles, [], of_tile)

    last = b.sub(panel_count, INDEX(1))
    _fold(b, b.add(b.udiv(last, per_block), INDEX(1)), [], block)
    b.ret_void()
    return str(module)


def _brackets(
    b: ir.IRBuilder,
    splat: _Vectors,
    tile: Tile,
    query: Any,
    reference: Any,
    width: Any,
    *,
    direct: bool,
) -> Sequence:
    """Accumulate a tile over the dimensions: query-major, `vectors` values per query."""
    half_sums = splat.row(reference, width, tile.vectors)
    start = [splat.zero] * tile.vectors if direct else list(half_sums)

    def dimension(index: Any, sums: Sequence) -> Sequence:
        theirs = splat.row(reference, index, tile.vectors)
        ours = splat.scalars(query, index, tile.queries)
        pairs = [(q, x) for q in ours for x in theirs]
        terms = [
            intrinsic(b, "fabs", b.fsub(q, x))
            if direct
            else intrinsic(b, "maxnum", q, x, fastmath=FAST)
            for q, x in pairs
        ]
        return [b.fadd(total, term) for total, term in zip(sums, terms, strict=True)]

    return _fold(b, width, start * tile.queries, dimension)


def _weighed(
    b: ir.IRBuilder,
    splat: _Vectors,
    tile: Tile,
    brackets: Sequence,
    query: Any,
    reference: Any,
    width: Any,
    weight: Callable[[Any], Any],
    totals: Sequence,
) -> Sequence:
    """Return the totals Σ l w, Σ w, Σ w² of each query with this panel's weights added."""
    leverage = splat.row(reference, b.add(width, INDEX(1)), tile.vectors)
    factors = splat.scalars(query, width, tile.queries)
    offsets = splat.scalars(query, b.add(width, INDEX(1)), tile.queries)
    added = []
    for j in range(tile.queries):
        numerator, denominator, squares = totals[j :: tile.queries]
        for r in range(tile.vectors):
            w = weight(fmuladd(b, brackets[j * tile.vectors + r], factors[j], offsets[j]))
            numerator = fmuladd(b, leverage[r], w, numerator)
            denominator = b.fadd(denominator, w)
            squares = fmuladd(b, w, w, squares)
        added.append((numerator, denominator, squares))
    return [total for kind in zip(*added, strict=True) for total in kind]


def _store_minima(b: ir.IRBuilder, tile: Tile, brackets: Sequence, target: Any) -> None:
    for j in range(tile.queries):
        least, *others = brackets[j * tile.vectors : (j + 1) * tile.vectors]
        for other in others:
            least = intrinsic(b, "minnum", least, other, fastmath=FAST)
        smallest = intrinsic(b, "vector.reduce.fmin", least, result=FLOAT, fastmath=FAST)
        b.store(smallest, _at(b, target, INDEX(j)))


def _add_totals(b: ir.IRBuilder, totals: Sequence, target: Any) -> None:
    for position, total in enumerate(totals):
        place = _at(b, target, INDEX(position), DOUBLE)
        partial = intrinsic(
            b, "vector.reduce.fadd", FLOAT(0.0), total, result=FLOAT, fastmath=("reassoc",)
        )
        b.store(b.fadd(b.load(place, typ=DOUBLE), b.fpext(partial, DOUBLE)), place)


def _fold(
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


class _Vectors:
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
        start = _at(self.b, base, self.b.mul(row, INDEX(count * self.lanes)))
        places = [_at(self.b, start, INDEX(i * self.lanes)) for i in range(count)]
        return [self.b.load(place, typ=self.type, align=4) for place in places]

    def scalars(self, base: Any, row: Any, count: int) -> Sequence:
        """Load row `row` of an array with `count` numbers to a row, each repeated."""
        start = _at(self.b, base, self.b.mul(row, INDEX(count)))
        places = [_at(self.b, start, INDEX(i)) for i in range(count)]
        return [self(self.b.load(place, typ=FLOAT)) for place in places]


def _at(b: ir.IRBuilder, base: Any, index: Any, element: Any = FLOAT) -> Any:
    return b.gep(base, [index], source_etype=element)
