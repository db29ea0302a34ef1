"""Every observer by name; a new one is one line here."""

from __future__ import annotations

from pzt_ros.errors import named
from pzt_ros.observers.disturbance import DisturbanceObserver
from pzt_ros.observers.hysteresis import HysteresisObserver
from pzt_ros.observers.observer import Observer

OBSERVERS: dict[str, type[Observer]] = {
    observer.kind: observer for observer in (DisturbanceObserver, HysteresisObserver)
}


def find_observer(kind: str) -> type[Observer]:
    """The observer of that name.

    Raises:
        BenchError: there is none.
    """
    return named(OBSERVERS, kind, "observer")
