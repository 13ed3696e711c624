"""Loops compiled by numba, with their types kept for the type checker."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from numba import njit

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def compiled(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Compile a function on its first call; later processes load it from the cache."""
    loop: Callable[Arguments, Result] = njit(cache=True, nogil=True)(function)
    return loop
