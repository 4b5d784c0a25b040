"""Kernel rewards: the formulas of CoR and LCoR, and the engine that computes LCoR of whole stores.

LCoR of a query state is the mean of the references' leverages, weighted by a kernel of their L1
distance to the query. The formulas, and why α > 0, are in `formulas`. What costs time is that every
query meets every reference: 49,200 references times 2,048 queries are 100 million distances. How a
call runs, in the order in which it meets the modules:

1. A `LeverageField` hands its states (n, d) and leverages (n,), both float32, to `References`
   (module `references`), once. `rows` says how states are read, in parts, so that a mapped file
   will do, and finds a center near their mean. Subtracting it keeps float32 exact.
2. `panels` packs the centered references. A panel holds as many of them as a tile of registers,
   dimension by dimension, so that one vector load fetches one dimension of several references.

       panel = [ x₁ of 64 references | x₂ of 64 | … | x_d of 64 | −Σx/2 of 64 | leverage of 64 ]

3. `References.sums(queries, alpha=…)` centers the queries and calls `passes.run_parallel`. It cuts
   the queries into parts for the threads (or the references, where the queries are few), and gets
   machine code from `native`, which compiles it once per processor, kind of power and products.
4. A `Pass` is one run of that code: tiles of queries against blocks of panels. The text of the
   code is written by `inner_loop`. For a tile of 6 queries × 4 vectors of 16 references (AVX-512),
   all distances are added up in registers over the dimensions; then one multiplication and addition
   makes t = (α + d) / (α + d₀) of each, `power` makes w = t^(−(α+1)/2), and `products` adds l w,
   w and w² to the query's totals. `instructions` has the few LLVM instructions they all need.

       for each block of 1,024 references (in the cache):           float64 sums, joined last
           for each tile of queries:                                float32 totals in registers
               for each panel of the block:
                   for each dimension: 24 vectors of distances grow
                   power, products, and the smallest distance in the panel

5. `exact.exact_sums` rescales the sums to the nearest reference (`log_scale`), runs the pass again
   for queries whose weights float32 could not hold, and finds which references are nearest, in
   the panels whose smallest distance is least.
6. The result is `Sums` (module `sums`): Σ l w, Σ w, Σ w². Their ratio is LCoR; (Σ w)² / Σ w² is the
   effective sample size. Sums over shards add up.

The same sums without machine code, in plain torch, are in `chunked`: for processors that no tile is
written for, for other devices, and for α below `references.MIN_COMPILED_ALPHA`.

The sampled way answers from a random part, with an error bound, where the references are very many:

1. `totals` tabulates all references once, so that Σ d and Σ l d over all of them cost O(d) a query.
2. `sample` packs a growing random sample of them, and runs the same passes with the products
   `MOMENTS` in place of `SUMS`; `moments` adds the parts up.
3. `regression` regresses the kernel on leverage and distance, whose totals are known from step 1,
   and estimates LCoR with a standard deviation and bounds (`estimates.Estimate`).
4. `query_estimates` adds up the moments of some queries while the sample grows. `sampled.Sampled`
   lets it grow until the half-width is small enough or the time is over, and answers exactly where
   that is faster.
"""

from ssil_data.kernels.estimates import Estimate
from ssil_data.kernels.formulas import Moments, check_alpha, cor, log_kernel
from ssil_data.kernels.references import References, lcor_sums
from ssil_data.kernels.sampled import Sampled
from ssil_data.kernels.sums import Sums

__all__ = [
    "Estimate",
    "Moments",
    "References",
    "Sampled",
    "Sums",
    "check_alpha",
    "cor",
    "lcor_sums",
    "log_kernel",
]
