"""The end of a refit."""

from __future__ import annotations

from pzt_ros.diagnosis.histories import renewed
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted

_LONG = 30  # steps more, for those that may win


def finished(found: Hypothesis, further: bool) -> Hypothesis:
    """Exact, and fitted further where it could have come further: what is left must not be taken for an effect."""
    if further:
        found = renewed(fitted(found.staged, found.vector, found.effects, _LONG))
    return exact(found)
