"""Offline simulation of a chain over a drive, block by block, so that long drives need little memory."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import check_bounds, parameters_of
from pzt_ros.records import read_csv, write_text

RUN_HEADER = ("time_s", "voltage_V", "displacement_m", "polarization_C_per_m2", "phase_fraction")
DRIVE_COLUMNS = ("time_s", "voltage_V")
ACCURACY = 1e-8
"""Error of the integration that the offline simulation allows by default [-]."""

_ROWS = 100_000
_RAMP = 1.0  # from rest at 0 V to the first voltage [s]

Drive = Iterator[tuple[Array, Array]]


def with_accuracy(chain: Chain, accuracy: float) -> Chain:
    """The chain with the accuracy of its integration replaced.

    Raises:
        BenchError: the accuracy is outside a link's bounds.
    """

    def change(link: Link) -> Link:
        declared = parameters_of(link).get("accuracy")
        if declared is None:
            return link
        check_bounds(accuracy, declared, f"--accuracy for {link.kind}")
        return dataclasses.replace(link, **{"accuracy": accuracy})

    return chain.with_links(change)


def simulate(chain: Chain, drive: Drive) -> Iterator[Signals]:
    """Run the chain over blocks of times [s] and voltages [V], linear between them; yields block by block.

    The first sample is the state at rest, not a step: a drive that starts at 0 V finds the chain's own initial state,
    one that starts elsewhere comes there from 0 V in a second.

    Raises:
        BenchError: the chain does not give all that a run has.
    """
    state = None
    for time, voltage in drive:
        if state is None:
            at_rest = voltage[0] == 0.0
            state = chain.init(Rest(time=float(time[0]) - (0.0 if at_rest else _RAMP)))
        state, out = chain.step(state, Signals(time=time, voltage=voltage))
        for name in ("displacement", "polarization", "phase_fraction"):
            if getattr(out, name).size != time.size:
                raise BenchError(f"{chain.name}: the chain gives no {name}; a simulated run needs a link that does")
        yield out.replace(voltage=voltage)


def simulate_csv(chain: Chain, drive: Path | Drive, out: Path) -> int:
    """Simulate a drive, from a CSV file or given as blocks, into a CSV file; returns the number of rows.

    Raises:
        BenchError: as `simulate`; the drive cannot be read, or the run not be written.
    """
    rows = 0

    def lines() -> Iterator[str]:
        nonlocal rows
        yield ",".join(RUN_HEADER) + "\n"
        for block in simulate(chain, read_drive(drive) if isinstance(drive, Path) else drive):
            rows += block.time.size
            columns = (block.time, block.voltage, block.displacement, block.polarization, block.phase_fraction)
            yield "".join(map("%r,%r,%r,%r,%r\n".__mod__, zip(*(column.tolist() for column in columns), strict=True)))

    write_text(out, lines())
    return rows


def read_drive(path: Path) -> Drive:
    """Blocks of times [s] and voltages [V] of a CSV file.

    Plain files are read block by block. Whatever looks odd is given to `read_csv`, which knows what is wrong and where.

    Raises:
        BenchError: as `read_csv`.
    """
    try:
        stream = path.open(encoding="utf-8-sig", newline="\n")
    except OSError:
        read_csv(path, DRIVE_COLUMNS)
        raise
    with stream:
        read, previous = 0, -np.inf
        header = _plain_header(stream)
        while header is not None:
            block = _plain_block(stream, header, previous)
            if block is None:
                break
            time, voltage = block
            if time.size == 0:
                if read > 1:
                    return
                break
            read, previous = read + time.size, float(time[-1])
            yield time, voltage
    record = read_csv(path, DRIVE_COLUMNS)
    for low in range(read, len(record), _ROWS):
        yield record.time[low : low + _ROWS], record.voltage[low : low + _ROWS]


def _plain_header(stream: Iterator[str]) -> list[str] | None:
    """Names of the columns, or None where the header needs a closer look."""
    try:
        header = [name.strip() for name in next(stream, "").split(",")]
    except UnicodeDecodeError:
        return None
    plain = all(header.count(name) == 1 for name in DRIVE_COLUMNS) and not any('"' in name for name in header)
    return header if plain else None


def _plain_block(stream: Iterator[str], header: list[str], previous: float) -> tuple[Array, Array] | None:
    """The next rows, no rows at the end, or None where they need a closer look."""
    try:
        lines = list(islice(stream, _ROWS))
        if not lines:
            return np.empty(0), np.empty(0)
        if any(line.count(",") != len(header) - 1 for line in lines):
            return None
        places = [header.index(name) for name in DRIVE_COLUMNS]
        table = np.loadtxt(lines, delimiter=",", comments=None, usecols=places, ndmin=2)
    except (UnicodeDecodeError, ValueError):
        return None
    rising = np.diff(table[:, 0], prepend=previous) > 0.0 if len(table) == len(lines) else np.array([False])
    if not (np.all(rising) and np.all(np.isfinite(table))):
        return None
    return table[:, 0].copy(), table[:, 1].copy()
