"""What keeps the first call short: Numba compiles every function as often, and with all that it comes with."""

from __future__ import annotations

from typing import Any, Final

from numba import njit

from pzt_ros.physics.signals import Array

WITHIN: Final[dict[str, Any]] = {"cache": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""For functions that only compiled ones call; without wrappers for Python they compile faster, by up to a third.

Python must not call them: that ends in a segmentation fault. Wrap one in an `njit` function to try it out.
"""

OUTER: Final[dict[str, Any]] = {"cache": True, "no_cfunc_wrapper": True}
"""For functions that Python calls too: it needs one of the two wrappers."""


@njit(**WITHIN)
def copy_onto(target: Array, source: Array) -> None:
    """Copy `source` onto `target` [both of shape (n,)]; they may not overlap.

    `target[:] = source` does the same, but it takes Numba two seconds of every first call.
    """
    for k in range(source.size):
        target[k] = source[k]
