r"""The inner loops of LCoR's sums as LLVM instructions, for any width of vectors.

|a − b| = 2 max(a, b) − a − b, so that a distance takes two instructions per dimension, not three:

    ‖q − x‖₁ = 2 (Σ_i max(q_i, x_i) − Σ_i x_i / 2) − Σ_i q_i

The bracket in parentheses is what a tile adds up, for a few queries times a few vectors of
references, in registers. One multiplication and addition per pair then turns it into
t = (α + d) / (α + d₀), or into u = t − 1, and w = t^(−p) with p = (α + 1)/2 is the kernel relative
to that at a distance d₀ that may differ from query to query. Far from the center, where the sums
cancel, |q_i − x_i| is added up directly; the bracket is then the distance itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from llvmlite import ir

from ssil_data.kernels.instructions import (
    DOUBLE,
    FAST,
    FLOAT,
    INDEX,
    POINTER,
    Vectors,
    at,
    constant,
    fmuladd,
    fold,
    intrinsic,
)
from ssil_data.kernels.power import Power
from ssil_data.kernels.products import Products

BLOCK = 1024
"""References that meet all queries of a pass before the next ones do: they stay in the cache.

Within a block products are added up in float32, from the first panel to the last, and blocks in
float64. The order is always the same, so the bits are, whatever the other queries and the threads.
"""


@dataclass(frozen=True)
class Tile:
    """What is in registers at a time: `queries` × `vectors` vectors of `lanes` references each."""

    lanes: int
    vectors: int
    queries: int

    @property
    def references(self) -> int:
        """References in a panel, the unit of packing."""
        return self.lanes * self.vectors

    @property
    def panels(self) -> int:
        """Panels in a block."""
        return BLOCK // self.references


def emit(tile: Tile, power: Power, products: Products, *, direct: bool) -> str:
    """Return the text, in LLVM's language, of a function that adds up products over references.

    Its arguments are, with every count at least 1:

    - panels (·, width + 2, references of a panel) float32: the dimensions, −Σx/2, leverage;
    - queries (tiles, width + 2, queries of a tile) float32: the dimensions, factor, offset of t;
    - sums (blocks, tiles, products.count, queries of a tile) float64, to be written: of each block;
    - nearest (tiles · queries of a tile, panels) float32, to be written: the smallest bracket in
      each panel;
    - width, number of panels, number of tiles, the first block to pass and the one after the last
      (only their part of `sums` and `nearest` is written), and p.

    Parameters
    ----------
    tile
        Shape of the registers.
    power
        How w is computed from t or u.
    products
        What is added up.
    direct
        Whether |q_i − x_i| is added up, in place of the maximum.
    """
    signature = ir.FunctionType(ir.VoidType(), [POINTER] * 4 + [INDEX] * 5 + [FLOAT])
    function = ir.Function(ir.Module(), signature, "sums")
    builder = ir.IRBuilder(function.append_basic_block())
    _SumsWriter(builder, tile, power, products, direct=direct).write()
    return str(function.module)


class _SumsWriter:
    """Writes the function's body: loops over blocks, tiles of queries, panels and dimensions."""

    def __init__(
        self, b: ir.IRBuilder, tile: Tile, power: Power, products: Products, *, direct: bool
    ) -> None:
        self.b = b
        self.tile = tile
        self.power = power
        self.products = products
        self.direct = direct
        self.panels, self.queries, self.sums, self.nearest, *rest = b.function.args
        self.width, self.panel_count, self.tile_count, self.begin, self.end, exponent = rest
        self.vectors = Vectors(b, tile.lanes)
        self.weight = power(b, self.vectors(exponent))

    def write(self) -> None:
        blocks = self.b.sub(self.end, self.begin)
        fold(self.b, blocks, [], lambda index, _: self._write_block(self.b.add(self.begin, index)))
        self.b.ret_void()

    def _write_block(self, block: Any) -> Sequence:
        """Pass all tiles of queries over the panels of a block."""
        most = INDEX(self.tile.panels)
        first = self.b.mul(block, most)
        left = self.b.sub(self.panel_count, first)
        count = self.b.select(self.b.icmp_unsigned("<", left, most), left, most)

        def write_tile(index: Any, _: Sequence) -> Sequence:
            query = self._write_address(self.queries, index, self.tile.queries)
            first_query = self.b.mul(index, INDEX(self.tile.queries))

            def write_panel(step: Any, totals: Sequence) -> Sequence:
                place = self.b.add(first, step)
                reference = self._write_address(self.panels, place, self.tile.references)
                brackets = self._write_brackets(query, reference)
                self._store_minima(brackets, first_query, place)
                return self._add_weighted(query, reference, brackets, totals)

            zeros = [self.vectors.zero] * (self.products.count * self.tile.queries)
            place = self.b.add(self.b.mul(block, self.tile_count), index)
            self._store_totals(fold(self.b, count, zeros, write_panel), place)
            return []

        return fold(self.b, self.tile_count, [], write_tile)

    def _write_address(self, base: Any, index: Any, columns: int) -> Any:
        """Write the address of tile or panel `index`, width + 2 rows of `columns` numbers."""
        size = self.b.mul(self.b.add(self.width, INDEX(2)), INDEX(columns))
        return at(self.b, base, self.b.mul(index, size))

    def _write_brackets(self, query: Any, reference: Any) -> Sequence:
        """Accumulate over the dimensions: `vectors` values for each query in turn."""
        half_sums = self.vectors.row(reference, self.width, self.tile.vectors)
        start = [self.vectors.zero] * self.tile.vectors if self.direct else list(half_sums)

        def write_dimension(index: Any, sums: Sequence) -> Sequence:
            theirs = self.vectors.row(reference, index, self.tile.vectors)
            ours = self.vectors.scalars(query, index, self.tile.queries)
            terms = [self._write_term(q, x) for q in ours for x in theirs]
            return [self.b.fadd(total, term) for total, term in zip(sums, terms, strict=True)]

        return fold(self.b, self.width, start * self.tile.queries, write_dimension)

    def _write_term(self, q: Any, x: Any) -> Any:
        """Write what one dimension adds to the bracket of a query and some references."""
        if self.direct:
            return intrinsic(self.b, "fabs", self.b.fsub(q, x))
        return intrinsic(self.b, "maxnum", q, x, fastmath=FAST)

    def _add_weighted(
        self, query: Any, reference: Any, brackets: Sequence, totals: Sequence
    ) -> Sequence:
        """Add a panel's products to the totals of all queries."""
        factor_row = self.width
        offset_row = self.b.add(self.width, INDEX(1))
        leverage = self.vectors.row(reference, offset_row, self.tile.vectors)
        factors = self.vectors.scalars(query, factor_row, self.tile.queries)
        offsets = self.vectors.scalars(query, offset_row, self.tile.queries)
        added = []
        for j in range(self.tile.queries):
            sums = totals[j :: self.tile.queries]
            for bracket, value in zip(self._brackets_of(brackets, j), leverage, strict=True):
                x = fmuladd(self.b, bracket, factors[j], offsets[j])
                u = self.b.fsub(x, constant(x.type, self.power.offset))
                sums = self.products.add(self.b, sums, u=u, w=self.weight(x), leverage=value)
            added.append(sums)
        return [total for kind in zip(*added, strict=True) for total in kind]

    def _brackets_of(self, brackets: Sequence, j: int) -> Sequence:
        """Return the vectors of query j of the tile."""
        return brackets[j * self.tile.vectors : (j + 1) * self.tile.vectors]

    def _store_minima(self, brackets: Sequence, first_query: Any, panel: Any) -> None:
        """Store the smallest bracket of each query in this panel."""
        for j in range(self.tile.queries):
            least, *others = self._brackets_of(brackets, j)
            for other in others:
                least = intrinsic(self.b, "minnum", least, other, fastmath=FAST)
            smallest = intrinsic(self.b, "vector.reduce.fmin", least, result=FLOAT, fastmath=FAST)
            row = self.b.mul(self.b.add(first_query, INDEX(j)), self.panel_count)
            self.b.store(smallest, at(self.b, self.nearest, self.b.add(row, panel)))

    def _store_totals(self, totals: Sequence, place: Any) -> None:
        """Store a block's totals of one tile, each added up over its lanes."""
        target = at(self.b, self.sums, self.b.mul(place, INDEX(len(totals))), DOUBLE)
        for position, total in enumerate(totals):
            partial = intrinsic(
                self.b, "vector.reduce.fadd", FLOAT(0.0), total, result=FLOAT, fastmath=("reassoc",)
            )
            element = at(self.b, target, INDEX(position), DOUBLE)
            self.b.store(self.b.fpext(partial, DOUBLE), element)
