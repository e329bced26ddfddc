"""Arguments of kernels in memory, and calls by address: see `compiled.Callback`."""

from __future__ import annotations

from typing import Any

import numba
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

# llvmlite, through numba, whose version it has to be.
ir = cgutils.ir

# Every function called by address takes two pointers to doubles, a number, and a pointer to stored arguments.
_DOUBLES = types.CPointer(types.float64)  # type: ignore[attr-defined]
SIGNATURE = types.int64(_DOUBLES, _DOUBLES, types.int64, types.voidptr)


def _borrowed(context: Any, builder: Any, type_: Any, value: Any) -> Any:
    """A value whose arrays own nothing: whoever stores it keeps them alive. Counting owners would take longer."""
    if isinstance(type_, types.Array):
        array = make_array(type_)(context, builder, value)
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        array.parent = cgutils.get_null_value(array.parent.type)
        return array._getvalue()
    if isinstance(type_, types.BaseTuple):  # type: ignore[attr-defined]
        for index, member in enumerate(type_.types):
            part = builder.extract_value(value, index)
            value = builder.insert_value(value, _borrowed(context, builder, member, part), index)
    return value


@intrinsic
def stored_size(typingctx: Any, arguments: Any) -> Any:
    """Bytes that `store` writes."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        size = context.get_abi_sizeof(context.get_value_type(signature.args[0]))
        return ir.Constant(ir.IntType(64), size)

    return types.int64(arguments), generate


@intrinsic
def store(typingctx: Any, arguments: Any, buffer: Any) -> Any:
    """Writes a (named) tuple of arrays and numbers into a buffer, an array of `stored_size` bytes.

    The arrays must be kept alive by other means for as long as the buffer is used.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        value = _borrowed(context, builder, signature.args[0], values[0])
        data = make_array(signature.args[1])(context, builder, values[1]).data
        builder.store(value, builder.bitcast(data, value.type.as_pointer()), align=1)
        return context.get_dummy_value()

    return types.void(arguments, buffer), generate


def loader(type_: Any) -> Any:
    """A function for kernels that reads what `store` has written, from a pointer, as a value of a numba type."""

    @intrinsic
    def load(typingctx: Any, pointer: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            llvm_type = context.get_value_type(type_)
            return builder.load(builder.bitcast(values[0], llvm_type.as_pointer()), align=1)

        return type_(pointer), generate

    return load


@intrinsic
def call(typingctx: Any, address: Any, first: Any, second: Any, number: Any, buffer: Any) -> Any:
    """Calls a function of `SIGNATURE` at an address, with two contiguous arrays, a number, and the stored arguments."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        integer = ir.IntType(64)
        doubles = ir.DoubleType().as_pointer()
        anything = ir.IntType(8).as_pointer()
        data = [make_array(signature.args[i])(context, builder, values[i]).data for i in (1, 2, 4)]
        function_type = ir.FunctionType(integer, [doubles, doubles, integer, anything])
        function = builder.inttoptr(values[0], function_type.as_pointer())
        return builder.call(function, [data[0], data[1], values[3], builder.bitcast(data[2], anything)])

    return types.int64(address, first, second, types.int64, buffer), generate


def type_of(example: Any) -> Any:
    """numba's type of a value."""
    return numba.typeof(example)
