"""How fast can this machine take a maximum and add it, with everything in registers?"""

from __future__ import annotations

import ctypes

import llvmlite.binding as llvm

from ssil_data.kernels.native import GENERIC, Target


class Floor:
    """A loop of max and add over independent registers, on vectors as wide as the engine's."""

    def __init__(self) -> None:
        target = Target.host() or GENERIC
        self.lanes = target.tile.lanes
        self.chains = target.tile.vectors * target.tile.queries
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        machine = llvm.Target.from_default_triple().create_target_machine(
            cpu=target.processor, features=target.features, opt=3
        )
        module = llvm.parse_assembly(_text(self.chains, self.lanes))
        self.engine = llvm.create_mcjit_compiler(module, machine)
        self.engine.finalize_object()
        address = self.engine.get_function_address("floor")
        self.run = ctypes.CFUNCTYPE(ctypes.c_float, ctypes.c_size_t, ctypes.c_float)(address)

    def __call__(self, pairs: int, width: int) -> None:
        """Take the maxima and additions of so many pairs of states with `width` dimensions."""
        self.run(pairs * width // (self.chains * self.lanes), 0.5)


def _text(chains: int, lanes: int) -> str:
    """Return the loop in LLVM's language."""
    vector = f"<{lanes} x float>"
    every = range(chains)
    phis = "\n".join(f"%a{i} = phi {vector} [ %x, %entry ], [ %c{i}, %loop ]" for i in every)
    body = "\n".join(
        f"%b{i} = call nnan nsz {vector} @llvm.maxnum.v{lanes}f32({vector} %a{i}, {vector} %x)\n"
        f"%c{i} = fadd {vector} %b{i}, %x"
        for i in every
    )
    total = "\n".join(f"%t{i} = fadd {vector} %c{i}, {f'%t{i - 1}' if i else '%x'}" for i in every)
    return f"""
declare {vector} @llvm.maxnum.v{lanes}f32({vector}, {vector})
define float @floor(i64 %n, float %s) {{
entry:
  %one = insertelement {vector} undef, float %s, i32 0
  %x = shufflevector {vector} %one, {vector} undef, <{lanes} x i32> zeroinitializer
  br label %loop
loop:
  %i = phi i64 [ 0, %entry ], [ %j, %loop ]
  {phis}
  {body}
  %j = add i64 %i, 1
  %more = icmp ult i64 %j, %n
  br i1 %more, label %loop, label %after
after:
  {total}
  %r = extractelement {vector} %t{chains - 1}, i32 0
  ret float %r
}}"""
