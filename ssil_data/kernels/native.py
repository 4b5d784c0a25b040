"""Machine code for the processor at hand, compiled in this process by LLVM."""

from __future__ import annotations

import ctypes
import mmap
import os
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from threading import Lock
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels.inner_loop import Tile, emit
from ssil_data.kernels.power import Power
from ssil_data.kernels.products import Products

_COMPILING = Lock()
_SIGNATURE = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4, *[ctypes.c_size_t] * 5, ctypes.c_float)


@dataclass(frozen=True)
class Target:
    """A processor to write code for: its tile, and its name and features in LLVM's terms."""

    tile: Tile
    processor: str
    features: str

    def for_one_query(self) -> Target:
        """Return the target for calls of a single query: a tile of one query."""
        return replace(self, tile=replace(self.tile, queries=1))

    @classmethod
    @cache
    def host(cls) -> Target | None:
        """Return this machine; None where no tile is known for it, or it runs no generated code."""
        if not _can_run_generated_code():
            return None
        features = llvm.get_host_cpu_features()
        processor = llvm.get_host_cpu_name()
        kind = llvm.get_process_triple().split("-")[0]
        # 512-bit vectors even where LLVM would rather keep the clock high
        wide = features.flatten() + ",-prefer-256-bit"
        if kind in ("aarch64", "arm64"):
            return cls(NEON, processor, features.flatten())
        if kind != "x86_64":
            return None
        if features.get("avx512f"):
            return cls(AVX512, processor, wide)
        if features.get("avx2") and features.get("fma"):
            return cls(AVX2, processor, features.flatten())
        return GENERIC


AVX512 = Tile(lanes=16, vectors=4, queries=6)
AVX2 = Tile(lanes=8, vectors=2, queries=5)
NEON = Tile(lanes=4, vectors=4, queries=6)
GENERIC = Target(Tile(lanes=4, vectors=2, queries=4), "", "")
"""Any 64-bit processor: the instructions that the first generation had."""


@dataclass(frozen=True)
class Code:
    """A compiled function, of the kind that its other fields say; it runs without Python's lock.

    `engine` owns the memory of `function` and must live as long.
    """

    tile: Tile
    power: Power
    products: Products
    direct: bool
    function: Any
    engine: Any

    def __call__(
        self,
        panels: NDArray[np.float32],
        queries: NDArray[np.float32],
        sums: NDArray[np.float64],
        brackets: NDArray[np.float32],
        *,
        blocks: tuple[int, int],
        exponent: float,
    ) -> None:
        """Fill blocks `blocks` (first, after the last) of `sums` and `brackets`, at p = `exponent`.

        All arrays are contiguous and shaped as `inner_loop.emit` says.
        """
        addresses = (array.ctypes.data for array in (panels, queries, sums, brackets))
        width = queries.shape[1] - 2
        self.function(*addresses, width, len(panels), len(queries), *blocks, exponent)


def _can_run_generated_code() -> bool:
    """Tell whether the system runs memory that was written: where it forbids that, LLVM aborts."""
    if os.name != "posix":
        return True
    page = mmap.mmap(-1, mmap.PAGESIZE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    address = ctypes.c_void_p(ctypes.addressof(ctypes.c_char.from_buffer(page)))
    runnable = mmap.PROT_READ | mmap.PROT_EXEC
    return ctypes.CDLL(None).mprotect(address, mmap.PAGESIZE, runnable) == 0


@lru_cache(maxsize=64)  # about 1 MB each
def compile_code(target: Target, power: Power, products: Products, *, direct: bool) -> Code:
    """Compile the function that `inner_loop.emit` describes; the latest 64 are remembered.

    Parameters
    ----------
    target
        Processor to write for.
    power
        How the kernel's power is computed.
    products
        What is added up.
    direct
        Whether distances are added up directly, for queries far from the center.
    """
    with _COMPILING:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        machine = llvm.Target.from_default_triple().create_target_machine(
            cpu=target.processor, features=target.features, opt=3
        )
        module = llvm.parse_assembly(emit(target.tile, power, products, direct=direct))
        engine = llvm.create_mcjit_compiler(module, machine)
        engine.finalize_object()
        function = _SIGNATURE(engine.get_function_address("sums"))
        return Code(target.tile, power, products, direct, function, engine)
