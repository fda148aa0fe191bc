"""The inner loops of the screening, as vectors of lanes that stay in registers.

Numba leaves vectors to the compiler, which enters each short loop by comparing the addresses of
all arrays. These comparisons took as long as the loops. Here the loops are written as
instructions of LLVM for vectors. LLVM translates them for any processor.

Arrays are C-contiguous. Their rows are one vector or several, and lanes are the columns.
"""

from contextlib import contextmanager

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

__all__ = [
    "FEATURES",
    "MOST_LEVEL",
    "SHIFT",
    "VECTOR",
    "lane_distances",
    "lane_levels",
    "lane_limits",
    "lane_moments",
]

VECTOR = 8  # float32 lanes of a vector; twice as many of int16
FEATURES = 9  # x, y, z, xx, xy, xz, yy, yz, zz
# A level is a float32 number without its last bits: 512 levels to each power of two.
SHIFT, STEPS = 14, 13
MOST_LEVEL = 2**STEPS - 1
FLOATS = ir.VectorType(ir.FloatType(), VECTOR)
BITS = ir.VectorType(ir.IntType(32), VECTOR)
LEVELS = ir.VectorType(ir.IntType(16), VECTOR)
WIDE = ir.VectorType(ir.IntType(16), 2 * VECTOR)
FREE = ("reassoc", "contract", "nsz", "arcp")  # as FASTMATH


@intrinsic
def lane_distances(typingctx, planes, features, n_rows, distances, total):
    """Absolute distances (rows, lanes) of members from planes (4, lanes), and their sums."""

    def generate(context, builder, signature, args):
        planes, features, distances, total = _arrays(context, builder, signature, args, 0, 1, 3, 4)
        magnitude = ir.Constant(BITS, [2**31 - 1] * VECTOR)  # all bits but the sign
        with _blocks(builder, planes, VECTOR) as lane:
            plane = [_load(builder, planes, i, lane, FLOATS) for i in range(4)]
            sums = _accumulators(builder, 1)
            with cgutils.for_range(builder, args[2]) as loop:
                value = plane[3]
                for i in range(3):
                    member = _spread(builder, features, loop.index, i)
                    product = builder.fmul(plane[i], member, flags=FREE)
                    value = builder.fadd(value, product, flags=FREE)
                value = builder.and_(builder.bitcast(value, BITS), magnitude)
                value = builder.bitcast(value, FLOATS)
                builder.store(value, _vector(builder, distances, loop.index, lane, FLOATS), align=4)
                _add(builder, sums[0], value)
            builder.store(builder.load(sums[0]), _vector(builder, total, 0, lane, FLOATS), align=4)

    return types.void(planes, features, n_rows, distances, total), generate


@intrinsic
def lane_levels(typingctx, bits, base, n_rows, levels):
    """Levels int16 (rows, lanes): bits without the last, less a base, within 0 and MOST_LEVEL."""

    def generate(context, builder, signature, args):
        bits, base, levels = _arrays(context, builder, signature, args, 0, 1, 3)
        zero = ir.Constant(BITS, None)
        shift = ir.Constant(BITS, [SHIFT] * VECTOR)
        most = ir.Constant(BITS, [MOST_LEVEL] * VECTOR)
        with _blocks(builder, bits, VECTOR) as lane:
            lowest = _load(builder, base, 0, lane, BITS)
            with cgutils.for_range(builder, args[2]) as loop:
                value = _load(builder, bits, loop.index, lane, BITS)
                value = builder.sub(builder.ashr(value, shift), lowest)
                value = builder.select(builder.icmp_signed(">", value, zero), value, zero)
                value = builder.select(builder.icmp_signed("<", value, most), value, most)
                place = _vector(builder, levels, loop.index, lane, LEVELS)
                builder.store(builder.trunc(value, LEVELS), place, align=2)

    return types.void(bits, base, n_rows, levels), generate


@intrinsic
def lane_limits(typingctx, levels, n_rows, wanted, limits):
    """The largest level, of each lane, that no more than `wanted` rows are below.

    It is found by bisection. `n_rows` is even.
    """

    def generate(context, builder, signature, args):
        levels, limits = _arrays(context, builder, signature, args, 0, 3)
        wanted = context.cast(builder, args[2], signature.args[2], types.int16)
        wanted = _splat(builder, wanted, WIDE)
        first = ir.Constant(WIDE, [2 ** (STEPS - 1)] * 2 * VECTOR)
        zero, one = ir.Constant(WIDE, None), ir.Constant(WIDE, [1] * 2 * VECTOR)
        n_steps, first_row, pair = (context.get_constant(types.intp, i) for i in (STEPS, 0, 2))
        with _blocks(builder, levels, 2 * VECTOR) as lane:
            low, step = cgutils.alloca_once(builder, WIDE), cgutils.alloca_once(builder, WIDE)
            # Two counts, of even and odd rows, because each sum waits for the one before.
            counts = [cgutils.alloca_once(builder, WIDE) for _ in range(2)]
            builder.store(zero, low)
            builder.store(first, step)
            with cgutils.for_range(builder, n_steps):
                guess = builder.add(builder.load(low), builder.load(step))
                for count in counts:
                    builder.store(zero, count)
                with cgutils.for_range_slice(builder, first_row, args[1], pair) as (row, _):
                    rows = row, builder.add(row, ir.Constant(row.type, 1))
                    for count, j in zip(counts, rows, strict=True):
                        level = _load(builder, levels, j, lane, WIDE)
                        below = builder.sext(builder.icmp_signed("<", level, guess), WIDE)
                        builder.store(builder.sub(builder.load(count), below), count)
                total = builder.add(builder.load(counts[0]), builder.load(counts[1]))
                fits = builder.icmp_signed("<=", total, wanted)
                builder.store(builder.select(fits, guess, builder.load(low)), low)
                builder.store(builder.ashr(builder.load(step), one), step)
            builder.store(builder.load(low), _vector(builder, limits, 0, lane, WIDE), align=2)

    return types.void(levels, n_rows, wanted, limits), generate


@intrinsic
def lane_moments(typingctx, distances, limits, features, n_rows, moments):
    """Number of rows nearer than each lane's limit, and sums of their features, (10, lanes)."""

    def generate(context, builder, signature, args):
        distances, limits, features, moments = _arrays(
            context, builder, signature, args, 0, 1, 2, 4
        )
        zero, one = ir.Constant(FLOATS, None), ir.Constant(FLOATS, [1.0] * VECTOR)
        with _blocks(builder, limits, VECTOR) as lane:
            limit = _load(builder, limits, 0, lane, FLOATS)
            sums = _accumulators(builder, 1 + FEATURES)
            with cgutils.for_range(builder, args[3]) as loop:
                row = _load(builder, distances, loop.index, lane, FLOATS)
                member = builder.select(builder.fcmp_ordered("<", row, limit), one, zero)
                _add(builder, sums[0], member)
                for i in range(FEATURES):
                    feature = _spread(builder, features, loop.index, i)
                    _add(builder, sums[1 + i], builder.fmul(member, feature, flags=FREE))
            for i, total in enumerate(sums):
                place = _vector(builder, moments, i, lane, FLOATS)
                builder.store(builder.load(total), place, align=4)

    return types.void(distances, limits, features, n_rows, moments), generate


def _arrays(context, builder, signature, args, *chosen):
    """Address of the data, and number of columns, of the chosen arguments."""
    found = []
    for i in chosen:
        array = context.make_array(signature.args[i])(context, builder, args[i])
        shape = cgutils.unpack_tuple(builder, array.shape)
        found.append((array.data, shape[-1]))
    return found


@contextmanager
def _blocks(builder, array, width):
    """A loop over the lanes of an array in steps of a vector."""
    n_lanes = array[1]
    start, step = ir.Constant(n_lanes.type, 0), ir.Constant(n_lanes.type, width)
    with cgutils.for_range_slice(builder, start, n_lanes, step) as (lane, _):
        yield lane


def _load(builder, array, row, lane, kind):
    return builder.load(_vector(builder, array, row, lane, kind), align=2)


def _vector(builder, array, row, lane, kind):
    """Address of the vector of an array at a row and a lane."""
    data, n_lanes = array
    row = ir.Constant(n_lanes.type, row) if isinstance(row, int) else row
    place = builder.add(builder.mul(row, n_lanes), lane)
    return builder.bitcast(builder.gep(data, [place]), kind.as_pointer())


def _spread(builder, features, row, column):
    """A feature of a member, in all lanes."""
    data, width = features
    place = builder.add(builder.mul(row, width), ir.Constant(width.type, column))
    return _splat(builder, builder.load(builder.gep(data, [place])), FLOATS)


def _splat(builder, value, kind):
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.IntType(32)(0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), None)
    return builder.shuffle_vector(one, ir.Constant(kind, ir.Undefined), order)


def _accumulators(builder, n):
    found = [cgutils.alloca_once(builder, FLOATS) for _ in range(n)]
    for place in found:
        builder.store(ir.Constant(FLOATS, None), place)
    return found


def _add(builder, place, value):
    builder.store(builder.fadd(builder.load(place), value, flags=FREE), place)
