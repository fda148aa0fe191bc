"""Vectors as values of compiled functions: as many numbers as a cache line, in registers.

Numba leaves vectors to the compiler. It finds them in loops over arrays, enters each loop by
comparing the addresses of all arrays, and keeps sums in memory. These functions are instructions
for vectors, which LLVM translates for any processor. Where Numba is told not to compile, NumPy does
the same.
"""

from functools import wraps

import numpy as np
from llvmlite import ir
from numba import config, types
from numba.extending import intrinsic, models, register_model

BITS = 512  # of a vector: the widest registers have as many
FREE = "reassoc", "contract", "nsz", "arcp"  # as FASTMATH


class Vector(types.Type):
    """Numbers of one type."""

    def __init__(self, number):
        super().__init__(f"Vector({number})")
        self.number = number


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        number = manager.lookup(kind.number).get_value_type()
        super().__init__(manager, kind, ir.VectorType(number, BITS // kind.number.bitwidth))


def _compiled(plain):
    """Decorate what Numba compiles, to be replaced by what is `plain` NumPy if it doesn't."""
    return lambda typed: plain if config.DISABLE_JIT else intrinsic(typed)


def _instruction(write):
    """What a function of vectors and numbers of one type is, from what writes it for LLVM."""

    @wraps(write)  # for the number of its arguments
    def typed(typingctx, *kinds):
        vectors = [kind for kind in kinds if isinstance(kind, Vector)] or [Vector(kinds[0])]

        def generate(context, builder, signature, args):
            empty = ir.Constant(context.get_value_type(vectors[0]), ir.Undefined)
            first = ir.Constant(ir.VectorType(ir.IntType(32), empty.type.count), None)

            def spread(value):
                one = builder.insert_element(empty, value, ir.IntType(32)(0))
                return builder.shuffle_vector(one, empty, first)

            return write(builder, *(a if a.type == empty.type else spread(a) for a in args))

        return vectors[0](*kinds), generate

    return typed


@_compiled(lambda number: number)
@_instruction
def spread(_, number):
    """The vector that has the number everywhere."""
    return number


@_compiled(lambda a, b, c: a * b + c)
@_instruction
def multiply_add(builder, a, b, c):
    return builder.fadd(builder.fmul(a, b, flags=FREE), c, flags=FREE)


@_compiled(lambda a, b: a + b)
@_instruction
def add(builder, a, b):
    if isinstance(a.type.element, ir.IntType):
        return builder.add(a, b)
    return builder.fadd(a, b, flags=FREE)


@_compiled(lambda a, b, c, d: np.where(a < b, c, d))
@_instruction
def where_below(builder, a, b, c, d):
    """c where a < b, else d."""
    if isinstance(a.type.element, ir.IntType):
        return builder.select(builder.icmp_signed("<", a, b), c, d)
    return builder.select(builder.fcmp_ordered("<", a, b), c, d, flags=FREE)


@_compiled(lambda row, start: row[start : start + BITS // 8 // row.itemsize].copy())
def load(typingctx, row, start):
    """The vector that begins at a place of a row."""
    vector = Vector(row.dtype)

    def generate(context, builder, signature, args):
        return builder.load(_address(context, builder, row, vector, *args), align=1)

    return vector(row, types.intp), generate


@_compiled(lambda vector, row, start: np.copyto(row[start : start + len(vector)], vector))
def store(typingctx, vector, row, start):
    def generate(context, builder, signature, args):
        builder.store(args[0], _address(context, builder, row, vector, *args[1:]), align=1)
        return context.get_dummy_value()

    return types.none(vector, row, types.intp), generate


def _address(context, builder, kind, vector, row, start):
    row, pointer = context.make_array(kind)(context, builder, row), context.get_value_type(vector)
    return builder.bitcast(builder.gep(row.data, [start]), pointer.as_pointer())
