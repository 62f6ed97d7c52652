"""Intrinsics for numbers and functions at an address, for arrays of MuJoCo and ``mj_step``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import carray, types  # type: ignore[attr-defined]  # numba declares no __all__
from numba.core import cgutils
from numba.extending import intrinsic

from articulate.jit import row_function

_intrinsic: Callable[[Any], Any] = intrinsic  # its annotation omits the first argument


@_intrinsic
def doubles(typingctx: Any, address: Any) -> Any:
    """Return the address as a pointer to float64."""
    sig = types.CPointer(types.float64)(types.int64)  # type: ignore[no-untyped-call]  # numba's

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return sig, codegen


@_intrinsic
def call(typingctx: Any, function: Any, first: Any, second: Any) -> Any:
    """Call the C function ``void f(void*, void*)`` at an address."""
    sig = types.void(types.int64, types.int64, types.int64)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        from llvmlite import ir  # type: ignore[import-untyped]  # comes with numba

        pointer = cgutils.voidptr_t
        kind = ir.FunctionType(ir.VoidType(), [pointer, pointer])
        target = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(target, [builder.inttoptr(a, pointer) for a in args[1:]])
        return context.get_dummy_value()

    return sig, codegen


@_intrinsic
def test_and_set(typingctx: Any, address: Any) -> Any:
    """Write 1 to the int64 at the address and return its last value, atomically."""
    sig = types.int64(types.int64)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        from llvmlite import ir

        word = ir.IntType(64)
        target = builder.inttoptr(args[0], word.as_pointer())
        return builder.atomic_rmw("xchg", target, word(1), "acq_rel")

    return sig, codegen


@row_function
def copy_numbers(source: int, target: int, n: int) -> None:
    """Copy ``n`` float64 from one address to another."""
    read, write = carray(doubles(source), n), carray(doubles(target), n)
    for k in range(n):
        write[k] = read[k]


@row_function
def array_at(address: int, n: int) -> Any:
    """Return the ``n`` float64 at an address as an array."""
    return carray(doubles(address), n)
