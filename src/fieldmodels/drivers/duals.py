"""Dual numbers for compiled kernels: a value with its derivatives in eight directions, carried along exactly.

A kernel that is written for numbers runs with these in their place: Numba compiles it anew for the type. The
derivatives lie in one vector of the processor. Comparisons, ``floor`` and ``ceil`` look at the value alone:
a derivative is that of the branch that is taken.

In memory a dual takes nine numbers, the value first. ``numbers_2`` lets a kernel see an array of floats of
shape (m, n) as it is, and one of shape (m, n, 9) as duals of shape (m, n); ``numbers_1`` and so on likewise.
"""

from __future__ import annotations

import hashlib
import math
import operator
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from llvmlite import ir
from numba.core import cgutils as numba_cgutils
from numba.core import extending, imputils, types
from numba.core import typeconv as numba_typeconv
from numba.core.datamodel import models
from numba.core.typing import templates
from numba.np import arrayobj as numba_arrayobj

from fieldmodels.elementary import value_of

# Numba says few of its types.
arrayobj: Any = numba_arrayobj
cgutils: Any = numba_cgutils
impl_ret_borrowed: Any = imputils.impl_ret_borrowed
infer_global: Any = templates.infer_global
intrinsic: Any = extending.intrinsic
lower_builtin: Any = imputils.lower_builtin
lower_cast: Any = imputils.lower_cast
overload: Any = extending.overload
primitive: Any = models.PrimitiveModel
register_model: Any = extending.register_model
signature: Any = templates.signature
Conversion: Any = vars(numba_typeconv)["Conversion"]

DIRECTIONS = 8
"""Derivatives that one dual carries."""
WIDTH = DIRECTIONS + 1
"""Numbers that one takes in memory."""
_VECTOR = ir.VectorType(ir.DoubleType(), DIRECTIONS)
_PACKED = ir.LiteralStructType([ir.DoubleType(), _VECTOR], packed=True)  # no alignment beyond a float's


class DualType(types.Type):
    """The type; its name tells this file's content, so that no kernel on disk outlives an edit."""

    def __init__(self) -> None:
        edition = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:12]
        super().__init__(name=f"dual_{DIRECTIONS}_{edition}")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """Numbers become duals without derivatives."""
        del typingctx
        return Conversion.safe if isinstance(other, types.Float | types.Integer) else None

    def unify(self, typingctx: Any, other: Any) -> Any:
        """What is a number on one way and a dual on another is a dual."""
        del typingctx
        return self if isinstance(other, types.Float | types.Integer) else None


DUAL = DualType()


@register_model(DualType)
class _DualModel(primitive):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _PACKED)


class _Writer:
    """Writes a rule's code: arithmetic of numbers and of their derivatives (None for a plain number's)."""

    def __init__(self, context: Any, builder: Any) -> None:
        self.context, self.builder = context, builder

    def read(self, kind: Any, argument: Any) -> tuple[Any, Any]:
        """Value and derivatives of an argument."""
        if isinstance(kind, DualType):
            return self.builder.extract_value(argument, 0), self.builder.extract_value(argument, 1)
        return self.context.cast(self.builder, argument, kind, types.float64), None

    def pack(self, value: Any, slope: Any) -> Any:
        """A dual."""
        slope = ir.Constant(_VECTOR, [0.0] * DIRECTIONS) if slope is None else slope
        first = self.builder.insert_value(ir.Constant(_PACKED, ir.Undefined), value, 0)
        return self.builder.insert_value(first, slope, 1)

    def scaled(self, slope: Any, number: Any) -> Any:
        """Derivatives times a number."""
        if slope is None:
            return None
        undefined = ir.Constant(_VECTOR, ir.Undefined)
        one = self.builder.insert_element(undefined, number, cgutils.int32_t(0))
        lanes = ir.Constant(ir.VectorType(ir.IntType(32), DIRECTIONS), [0] * DIRECTIONS)
        return self.builder.fmul(slope, self.builder.shuffle_vector(one, undefined, lanes))

    def added(self, a: Any, b: Any) -> Any:
        """Derivatives of a sum."""
        return b if a is None else a if b is None else self.builder.fadd(a, b)

    def negated(self, slope: Any) -> Any:
        """Derivatives of the negative."""
        return None if slope is None else self.builder.fneg(slope)

    def call(self, function: Any, *numbers: Any, result: Any = types.float64) -> Any:
        """What a function of numbers gives."""
        kinds = signature(result, *[types.float64] * len(numbers))
        self.context.typing_context.resolve_function_type(function, kinds.args, {})
        return self.context.get_function(function, kinds)(self.builder, numbers)

    def number(self, value: float) -> Any:
        """A constant."""
        return ir.Constant(ir.DoubleType(), value)


Rule = Callable[..., tuple[Any, Any]]


def _register(function: Any, cases: Sequence[Any], lower: Callable[..., Any]) -> None:
    """Give a function of Python's another meaning for some types."""
    name = f"_{function.__name__}"
    infer_global(function)(type(name, (templates.ConcreteTemplate,), {"cases": list(cases)}))
    for case in cases:
        lower_builtin(function, *case.args)(lower)


PAIRS = [(DUAL, DUAL)] + [
    pair for plain in (types.float64, types.int64) for pair in ((DUAL, plain), (plain, DUAL))
]


def _binary(function: Any, rule: Rule) -> None:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        w = _Writer(context, builder)
        read = [w.read(kind, argument) for kind, argument in zip(sig.args, args, strict=True)]
        return w.pack(*rule(w, *read[0], *read[1]))

    _register(function, [signature(DUAL, *pair) for pair in PAIRS], lower)


def _unary(function: Any, rule: Rule) -> None:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        w = _Writer(context, builder)
        return w.pack(*rule(w, *w.read(sig.args[0], args[0])))

    _register(function, [signature(DUAL, DUAL)], lower)


def _comparison(function: Any, symbol: str) -> None:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        w = _Writer(context, builder)
        a, b = (w.read(kind, argument)[0] for kind, argument in zip(sig.args, args, strict=True))
        compare = builder.fcmp_unordered if symbol == "!=" else builder.fcmp_ordered
        return compare(symbol, a, b)

    _register(function, [signature(types.boolean, *pair) for pair in PAIRS], lower)


def _of_value(function: Any, result: Any, by: Any = None) -> None:
    """A function of the value alone; ``by`` another one, where Numba writes it otherwise."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        w = _Writer(context, builder)
        return w.call(by or function, w.read(sig.args[0], args[0])[0], result=result)

    _register(function, [signature(result, DUAL)], lower)


def _floor_divided(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    w = _Writer(context, builder)
    numbers = [w.read(kind, argument)[0] for kind, argument in zip(sig.args, args, strict=True)]
    return w.call(operator.floordiv, *numbers)


def _add(w: _Writer, a: Any, da: Any, b: Any, db: Any) -> tuple[Any, Any]:
    return w.builder.fadd(a, b), w.added(da, db)


def _subtract(w: _Writer, a: Any, da: Any, b: Any, db: Any) -> tuple[Any, Any]:
    if da is not None and db is not None:
        return w.builder.fsub(a, b), w.builder.fsub(da, db)
    return w.builder.fsub(a, b), w.added(da, w.negated(db))


def _multiply(w: _Writer, a: Any, da: Any, b: Any, db: Any) -> tuple[Any, Any]:
    return w.builder.fmul(a, b), w.added(w.scaled(da, b), w.scaled(db, a))


def _divide(w: _Writer, a: Any, da: Any, b: Any, db: Any) -> tuple[Any, Any]:
    quotient = w.builder.fdiv(a, b)
    inverse = w.builder.fdiv(w.number(1.0), b)
    towards = w.negated(w.scaled(db, quotient))
    return quotient, w.scaled(w.added(da, towards), inverse)


def _power(w: _Writer, a: Any, da: Any, b: Any, db: Any) -> tuple[Any, Any]:
    value = w.call(operator.pow, a, b)
    below = w.call(operator.pow, a, w.builder.fsub(b, w.number(1.0)))
    slope = w.scaled(da, w.builder.fmul(b, below))
    if db is not None:
        slope = w.added(slope, w.scaled(db, w.builder.fmul(value, w.call(math.log, a))))
    return value, slope


def _remainder(w: _Writer, a: Any, da: Any, b: Any, db: Any) -> tuple[Any, Any]:
    left = w.call(operator.mod, a, b)
    whole = w.builder.fdiv(w.builder.fsub(a, left), b)
    return left, w.added(da, w.negated(w.scaled(db, whole)))


def _copysign(w: _Writer, a: Any, da: Any, b: Any, db: Any) -> tuple[Any, Any]:
    del db
    one = w.number(1.0)
    sign = w.builder.fmul(w.call(math.copysign, one, a), w.call(math.copysign, one, b))
    return w.call(math.copysign, a, b), w.scaled(da, sign)


def _extreme(function: Any, symbol: str) -> None:
    """The larger or smaller of two, as Python chooses: the first where they are alike."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        w = _Writer(context, builder)
        (a, da), (b, db) = (w.read(kind, argument) for kind, argument in zip(sig.args, args, strict=True))
        return builder.select(builder.fcmp_ordered(symbol, b, a), w.pack(b, db), w.pack(a, da))

    _register(function, [signature(DUAL, *pair) for pair in PAIRS], lower)


def _arctangent_of_two(w: _Writer, a: Any, da: Any, b: Any, db: Any) -> tuple[Any, Any]:
    square = w.builder.fadd(w.builder.fmul(a, a), w.builder.fmul(b, b))
    slope = w.added(
        w.scaled(da, w.builder.fdiv(b, square)), w.negated(w.scaled(db, w.builder.fdiv(a, square)))
    )
    return w.call(math.atan2, a, b), slope


def _hypotenuse(w: _Writer, a: Any, da: Any, b: Any, db: Any) -> tuple[Any, Any]:
    length = w.call(math.hypot, a, b)
    return length, w.added(w.scaled(da, w.builder.fdiv(a, length)), w.scaled(db, w.builder.fdiv(b, length)))


def _smooth(function: Any, derivative: Callable[[_Writer, Any, Any], Any]) -> None:
    """A function of one number; ``derivative`` of its argument and its value."""

    def rule(w: _Writer, a: Any, da: Any) -> tuple[Any, Any]:
        value = w.call(function, a)
        return value, w.scaled(da, derivative(w, a, value))

    _unary(function, rule)


def _absolute(w: _Writer, a: Any, da: Any) -> tuple[Any, Any]:
    one = w.number(1.0)
    return w.call(abs, a), w.scaled(da, w.call(math.copysign, one, a))


def _inverse(w: _Writer, number: Any) -> Any:
    return w.builder.fdiv(w.number(1.0), number)


def _inverse_root(w: _Writer, square: Any) -> Any:
    return _inverse(w, w.call(math.sqrt, square))


def _bell(w: _Writer, a: Any, sign: float) -> Any:
    """Slope of the error function, or of one less it: 2/sqrt(pi) exp(-a^2)."""
    height = w.number(sign * 2.0 / math.sqrt(math.pi))
    return w.builder.fmul(height, w.call(math.exp, w.builder.fneg(w.builder.fmul(a, a))))


def _one_less_square(w: _Writer, number: Any, sign: float) -> Any:
    """1 + sign number^2."""
    square = w.builder.fmul(number, number)
    return w.builder.fadd(w.number(1.0), w.builder.fmul(w.number(sign), square))


for _function, _rule in (
    (operator.add, _add), (operator.iadd, _add), (operator.sub, _subtract), (operator.isub, _subtract),
    (operator.mul, _multiply), (operator.imul, _multiply), (operator.truediv, _divide),
    (operator.itruediv, _divide),
):  # fmt: skip
    _binary(_function, _rule)
for _function, _rule in (
    (operator.pow, _power), (operator.ipow, _power), (math.pow, _power), (operator.mod, _remainder),
    (operator.imod, _remainder),
):  # fmt: skip
    _binary(_function, _rule)
_binary(math.copysign, _copysign)
_binary(math.atan2, _arctangent_of_two)
_binary(math.hypot, _hypotenuse)
_extreme(max, ">")
_extreme(min, "<")
_unary(operator.neg, lambda w, a, da: (w.builder.fneg(a), w.negated(da)))
_unary(operator.pos, lambda _, a, da: (a, da))
_unary(float, lambda _, a, da: (a, da))
_unary(abs, _absolute)
_unary(math.fabs, _absolute)
_smooth(math.sqrt, lambda w, _, value: w.builder.fdiv(w.number(0.5), value))
_smooth(math.exp, lambda _, __, value: value)
_smooth(math.expm1, lambda w, _, value: w.builder.fadd(value, w.number(1.0)))
_smooth(math.log, lambda w, a, _: _inverse(w, a))
_smooth(math.log2, lambda w, a, _: _inverse(w, w.builder.fmul(w.number(math.log(2.0)), a)))
_smooth(math.log10, lambda w, a, _: _inverse(w, w.builder.fmul(w.number(math.log(10.0)), a)))
_smooth(math.log1p, lambda w, a, _: _inverse(w, w.builder.fadd(w.number(1.0), a)))
_smooth(math.sin, lambda w, a, _: w.call(math.cos, a))
_smooth(math.cos, lambda w, a, _: w.builder.fneg(w.call(math.sin, a)))
_smooth(math.tan, lambda w, _, value: _one_less_square(w, value, 1.0))
_smooth(math.tanh, lambda w, _, value: _one_less_square(w, value, -1.0))
_smooth(math.sinh, lambda w, a, _: w.call(math.cosh, a))
_smooth(math.cosh, lambda w, a, _: w.call(math.sinh, a))
_smooth(math.atan, lambda w, a, _: _inverse(w, _one_less_square(w, a, 1.0)))
_smooth(math.asin, lambda w, a, _: _inverse_root(w, _one_less_square(w, a, -1.0)))
_smooth(math.acos, lambda w, a, _: w.builder.fneg(_inverse_root(w, _one_less_square(w, a, -1.0))))
_smooth(math.asinh, lambda w, a, _: _inverse_root(w, _one_less_square(w, a, 1.0)))
_smooth(math.acosh, lambda w, a, _: _inverse_root(w, w.builder.fneg(_one_less_square(w, a, -1.0))))
_smooth(math.atanh, lambda w, a, _: _inverse(w, _one_less_square(w, a, -1.0)))
_smooth(math.erf, lambda w, a, _: _bell(w, a, 1.0))
_smooth(math.erfc, lambda w, a, _: _bell(w, a, -1.0))
_smooth(math.radians, lambda w, _, __: w.number(math.pi / 180.0))
_smooth(math.degrees, lambda w, _, __: w.number(180.0 / math.pi))
for _compare, _symbol in (
    (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="), (operator.eq, "=="),
    (operator.ne, "!="),
):  # fmt: skip
    _comparison(_compare, _symbol)
_register(operator.floordiv, [signature(types.float64, *pair) for pair in PAIRS], _floor_divided)
_of_value(int, types.int64, math.trunc)
_of_value(round, types.int64)
_of_value(math.floor, types.int64)
_of_value(math.ceil, types.int64)
_of_value(math.trunc, types.int64)
_of_value(bool, types.boolean)
_of_value(math.isfinite, types.boolean)
_of_value(math.isnan, types.boolean)
_of_value(math.isinf, types.boolean)


def _constant(context: Any, builder: Any, kind: Any, to: Any, value: Any) -> Any:
    del to
    w = _Writer(context, builder)
    return w.pack(*w.read(kind, value))


lower_cast(types.Float, DualType)(_constant)
lower_cast(types.Integer, DualType)(_constant)


def _value(typingctx: Any, dual: Any) -> Any:
    del typingctx

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        del context, sig
        return builder.extract_value(args[0], 0)

    return signature(types.float64, dual), code


_extract: Any = intrinsic(_value)


def _value_of_dual(x: Any) -> Any:
    return (lambda x: _extract(x)) if isinstance(x, DualType) else None


overload(value_of, strict=False)(_value_of_dual)


def _numbers(rank: int) -> Any:
    """What lets a kernel see an array of floats of so many axes as it is, one of an axis more as duals."""

    def numbers(typingctx: Any, array: Any) -> Any:
        """The array, or the array of duals that it holds on its last axis."""
        del typingctx
        if array.ndim == rank:
            return signature(array, array), lambda *given: given[-1][0]
        kind = types.Array(DUAL, rank, "C")

        def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            source = arrayobj.make_array(sig.args[0])(context, builder, args[0])
            result = arrayobj.make_array(kind)(context, builder)
            arrayobj.populate_array(
                result,
                data=builder.bitcast(source.data, result.data.type),
                shape=cgutils.unpack_tuple(builder, source.shape)[:-1],
                strides=cgutils.unpack_tuple(builder, source.strides)[:-1],
                itemsize=context.get_constant(types.intp, 8 * WIDTH),
                meminfo=source.meminfo,
                parent=source.parent,
            )
            return impl_ret_borrowed(context, builder, kind, result._getvalue())

        return signature(kind, array), code

    return intrinsic(numbers)


numbers_1, numbers_2, numbers_3, numbers_4 = (_numbers(rank) for rank in (1, 2, 3, 4))
