"""Rows of a batch on several threads: kernels release the interpreter's lock, and rows are independent."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor, wait
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np


@lru_cache(maxsize=8)
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="rows")


os.register_at_fork(after_in_child=_pool.cache_clear)  # a child has none of its parent's threads


def _cut(value: Any, rows: slice) -> Any:
    if isinstance(value, np.ndarray):
        return value[rows]
    if isinstance(value, tuple):
        return type(value)(*(_cut(part, rows) for part in value))
    return value


def run_rows(
    threads: int, batch: int, kernel: Callable[..., object], *arguments: Any, whole: Collection[int] = ()
) -> None:
    """Call a kernel on shares of a batch, one a thread; the result is the same to the bit.

    Args:
        threads: How many; 1 calls the kernel on all rows, here.
        batch: Number of rows.
        kernel: Works in place, on each row apart.
        arguments: Of the kernel; arrays, also within named tuples, are cut along their first axis.
        whole: Places of the arguments that every share is given whole.
    """
    shares = min(threads, batch)
    if shares <= 1:
        kernel(*arguments)
        return
    ends = [batch * k // shares for k in range(shares + 1)]
    cut = [
        [a if i in whole else _cut(a, slice(*rows)) for i, a in enumerate(arguments)]
        for rows in pairwise(ends)
    ]
    running = [_pool(threads).submit(kernel, *share) for share in cut[1:]]
    try:
        kernel(*cut[0])
    finally:
        wait(running)
    for share in running:
        share.result()
