"""How the conformance tests get an instrument for each driver: what a driver needs outside of it is made here."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from gcs_server import GcsServer

from pzt_ros.records import Record, write_csv

RATE, SIZE = 1000.0, 10
"""Of the conformance tests [Hz, samples]."""


@contextmanager
def ready(settings: type, folder: Path, voltage: float = 0.0) -> Iterator[Any]:
    """Settings whose instrument is there, with `voltage` [V] at the stack where the instrument can have one.

    A driver that is not named here is tried as its defaults are. If it needs an instrument, give it a loopback here.
    """
    kind = settings.kind
    if kind == "gcs":
        with GcsServer(voltage) as server:
            yield dataclasses.replace(settings(), host="127.0.0.1", port=float(server.port), timeout=5.0)
    elif kind == "replay":
        yield dataclasses.replace(settings(), record=str(record(folder, voltage)))
    else:
        yield settings()


def record(folder: Path, voltage: float = 0.0, rate: float = RATE, count: int = 400) -> Path:
    """A recorded run: a sine of voltage that starts at `voltage`, and a displacement that follows it."""
    time = np.arange(count) / rate
    drive = voltage + 20.0 * np.sin(2 * np.pi * 5.0 * time)
    columns = {
        "time_s": 3.0 + time,
        "voltage_V": drive,
        "displacement_m": 1e-6 + 5e-8 * drive,
        "current_A": 1e-6 * np.gradient(drive, 1.0 / rate),
    }
    path = folder / "run.csv"
    write_csv(Record("run", columns), path)
    return path
