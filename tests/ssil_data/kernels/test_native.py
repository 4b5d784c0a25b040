"""Code is written for any processor, compiled once, and says which host it knows."""

import subprocess
import sys

import llvmlite.binding as llvm
import numpy as np
import pytest
import torch

from ssil_data.kernels import References
from ssil_data.kernels.inner_loop import emit
from ssil_data.kernels.native import AVX2, AVX512, NEON, Target, compile_code
from ssil_data.kernels.power import General, Power
from ssil_data.kernels.products import Products
from support.kernel_references import draw_references

REGISTERS = {"zmm": (AVX512, "x86_64", "x86-64-v4", "-prefer-256-bit", "vfmadd"),
             "ymm": (AVX2, "x86_64", "x86-64-v3", "", "vfmadd"),
             ".4s": (NEON, "aarch64", "neoverse-n1", "", "fmla")}  # fmt: skip


@pytest.mark.parametrize("products", Products)
@pytest.mark.parametrize("power", [Power.of(alpha) for alpha in (1.0, 2.0, 3.0, 7.5, 11.0, 99.0)])
@pytest.mark.parametrize("register", REGISTERS)
def test_a_tile_fills_the_registers_it_is_made_for(register: str, power: Power, products: Products):
    tile, kind, processor, features, multiply_add = REGISTERS[register]
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(f"{kind}-unknown-linux-gnu").create_target_machine(
        cpu=processor, features=features, opt=3
    )
    module = llvm.parse_assembly(emit(tile, power, products, direct=False))
    lines = machine.emit_assembly(module).splitlines()
    assert any(register in line and "max" in line for line in lines)
    assert any(register in line and multiply_add in line for line in lines)


def test_code_is_compiled_once():
    host = Target.host()
    if host is not None:
        assert compile_code(host, General(), Products.SUMS, direct=True) is compile_code(
            host, General(), Products.SUMS, direct=True
        )


@pytest.mark.parametrize(
    ("kind", "features", "tile"),
    [
        ("x86_64", {"avx512f": True, "avx2": True, "fma": True}, AVX512),
        ("x86_64", {"avx2": True, "fma": True}, AVX2),
        ("aarch64", {"neon": True}, NEON),
    ],
)
def test_the_host_decides_the_tile(monkeypatch: pytest.MonkeyPatch, kind, features, tile):
    monkeypatch.setattr(llvm, "get_process_triple", lambda: f"{kind}-unknown-linux-gnu")
    monkeypatch.setattr(llvm, "get_host_cpu_features", lambda: llvm.FeatureMap(features))
    host = Target.host.__wrapped__(Target)
    assert host is not None
    assert host.tile == tile


def test_an_unknown_host_has_no_target_and_still_answers(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(llvm, "get_process_triple", lambda: "riscv64-unknown-linux-gnu")
    assert Target.host.__wrapped__(Target) is None
    states, leverage = draw_references(0, 50, 3)
    sums = References(states, leverage, target=None).sums(states, alpha=1.0)
    assert np.isfinite(sums.values).all()


HARDENED = """
import ctypes, sys
MDWE, REFUSE_EXEC_GAIN = 65, 1
if sys.platform != "linux" or ctypes.CDLL(None).prctl(MDWE, REFUSE_EXEC_GAIN, 0, 0, 0):
    sys.exit(77)
import numpy as np
from ssil_data.kernels import References
from ssil_data.kernels.native import Target
assert Target.host() is None
states = np.eye(5, dtype=np.float32)
print(References(states, states[0]).sums(states[:1], alpha=1.0).values[0])
"""


def test_where_code_may_not_be_written_plain_torch_answers():
    done = subprocess.run([sys.executable, "-c", HARDENED], capture_output=True, text=True)
    if done.returncode == 77:
        pytest.skip("this system cannot forbid memory to be written and run")
    states = np.eye(5, dtype=np.float32)
    known = References(states, states[0]).sums(states[:1], alpha=1.0).values[0]
    assert float(done.stdout) == pytest.approx(known, abs=1e-6), done.stderr


@pytest.mark.parametrize("alpha", [1e-4, 1.0, 12.0])
@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_torch_answers_on_the_device_that_is_asked_for(device: str, alpha: float):
    if device == "cuda" and not torch.cuda.is_available():
        pytest.skip("no CUDA device")
    (states, leverage), (queries, _) = draw_references(0, 20_000, 9), draw_references(1, 130, 9)
    plain = References(states, leverage, target=None, device=device)
    found = plain.sums(queries, alpha=alpha, contributors=3)
    known = References(states, leverage).sums(queries, alpha=alpha, contributors=3)
    np.testing.assert_allclose(found.values, known.values, atol=1e-6)
    np.testing.assert_allclose(found.nearest_weight, known.nearest_weight, rtol=1e-4)
