"""Arithmetic on tuples of numbers whose length a compiler knows: written for one number, joined by halves.

``inlined`` compiles what is made here, or leaves it as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

Made = Callable[..., Any]


@cache
def take(n: int, apart: int, inlined: Made) -> Made:
    """``(w, at)`` to n numbers of a flat array, each ``apart`` places from the next."""
    if n == 1:

        @inlined
        def read(w, at):
            return (w[at],)

        return read
    half = n // 2
    reach, first, rest = half * apart, take(half, apart, inlined), take(n - half, apart, inlined)

    @inlined
    def read_halves(w, at):
        return first(w, at) + rest(w, at + reach)

    return read_halves


@cache
def put(n: int, apart: int, inlined: Made) -> Made:
    """``(w, at, t)``: write n numbers where ``take`` reads them."""
    if n == 1:

        @inlined
        def write(w, at, t):
            w[at] = t[0]

        return write
    half = n // 2
    reach, first, rest = half * apart, put(half, apart, inlined), put(n - half, apart, inlined)

    @inlined
    def write_halves(w, at, t):
        first(w, at, t[:half])
        rest(w, at + reach, t[half:])

    return write_halves


@cache
def along(n: int, inlined: Made) -> Made:
    """``(s, h, d)`` to ``s + h d``."""
    if n == 1:

        @inlined
        def go(s, h, d):
            return (s[0] + h * d[0],)

        return go
    half = n // 2
    first, rest = along(half, inlined), along(n - half, inlined)

    @inlined
    def go_halves(s, h, d):
        return first(s[:half], h, d[:half]) + rest(s[half:], h, d[half:])

    return go_halves


@cache
def changed(n: int, inlined: Made) -> Made:
    """``(t, i, value)`` to the same numbers with another i-th one."""
    if n == 1:

        @inlined
        def change(t, i, value):
            return (value if i == 0 else t[0],)

        return change
    half = n // 2
    first, rest = changed(half, inlined), changed(n - half, inlined)

    @inlined
    def change_halves(t, i, value):
        return first(t[:half], i, value) + rest(t[half:], i - half, value)

    return change_halves


@cache
def floats(n: int, inlined: Made) -> Made:
    """Numbers of any kind to floating-point ones."""
    if n == 1:

        @inlined
        def convert(t):
            return (float(t[0]),)

        return convert
    half = n // 2
    first, rest = floats(half, inlined), floats(n - half, inlined)

    @inlined
    def convert_halves(t):
        return first(t[:half]) + rest(t[half:])

    return convert_halves


def joined(functions: Sequence[Made], inlined: Made) -> Made:
    """What several functions return of the same arguments, as one tuple."""
    function = functions[0]
    if len(functions) == 1:

        @inlined
        def call(*given):
            return (function(*given),)

        return call
    half = len(functions) // 2
    first, rest = joined(functions[:half], inlined), joined(functions[half:], inlined)

    @inlined
    def call_halves(*given):
        return first(*given) + rest(*given)

    return call_halves
