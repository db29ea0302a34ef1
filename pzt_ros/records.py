"""A measured or simulated run as a time series with named SI columns, and its way in and out of a CSV file."""

from __future__ import annotations

import csv
import functools
import hashlib
import io
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pzt_ros.errors import BenchError

Array = NDArray[np.float64]

KNOWN_COLUMNS = (
    "time_s",
    "voltage_V",
    "displacement_m",
    "polarization_C_per_m2",
    "phase_fraction",
    "current_A",
    "temperature_K",
    "force_N",
    "neighbour_displacement_m",
    "reference_m",
    "command_voltage_V",
)
"""Columns that are read from a CSV file; all others are ignored with a warning."""

RUN_COLUMNS = ("time_s", "voltage_V", "displacement_m")

_ROWS_PER_WRITE = 50_000


@dataclass(frozen=True, eq=False)
class Record:
    """A time series with named SI columns; sampling may be uneven.

    Attributes:
        name: where it came from, for messages (a path or a word).
        columns: name with unit -> samples [each shape (n,), float64]; the first is `time_s`.
        warnings: one line for each thing in the source that the reader left out or found odd.
        fingerprint: of the data it was made from, where readings were replaced; empty: these are they.

    Raises:
        ValueError: the first column is not time_s, or the columns differ in length.
    """

    name: str
    columns: Mapping[str, Array]
    warnings: tuple[str, ...] = ()
    fingerprint: str = ""

    def __post_init__(self) -> None:
        columns = {key: np.ascontiguousarray(values, dtype=np.float64) for key, values in self.columns.items()}
        if next(iter(columns), "") != "time_s":
            raise ValueError(f"{self.name}: the first column must be time_s, found {list(columns)}")
        shapes = {key: values.shape for key, values in columns.items()}
        if any(shape != shapes["time_s"] or len(shape) != 1 for shape in shapes.values()):
            raise ValueError(f"{self.name}: all columns must be vectors of one length, found {shapes}")
        object.__setattr__(self, "columns", columns)

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, column: str) -> Array:
        """A column [shape (n,)]; BenchError where the record has none of that name."""
        try:
            return self.columns[column]
        except KeyError:
            raise BenchError(f"{self.name}: no column {column}; there are {', '.join(self.columns)}") from None

    @property
    def time(self) -> Array:
        """Sample times [s], strictly increasing."""
        return self["time_s"]

    @property
    def voltage(self) -> Array:
        """The drive as recorded [V]."""
        return self["voltage_V"]

    @property
    def displacement(self) -> Array:
        """Measured displacement [m]."""
        return self["displacement_m"]

    @property
    def polarization(self) -> Array | None:
        """P [C/m^2], where it was recorded."""
        return self.columns.get("polarization_C_per_m2")

    @property
    def phase_fraction(self) -> Array | None:
        """x+ [-], where it was recorded."""
        return self.columns.get("phase_fraction")

    @property
    def current(self) -> Array | None:
        """[A], where it was recorded."""
        return self.columns.get("current_A")

    @property
    def temperature(self) -> Array | None:
        """[K], where it was recorded."""
        return self.columns.get("temperature_K")

    @property
    def force(self) -> Array | None:
        """[N], where it was recorded."""
        return self.columns.get("force_N")

    @property
    def neighbour(self) -> Array | None:
        """Displacement of another axis of the stage [m], where it was recorded."""
        return self.columns.get("neighbour_displacement_m")

    @property
    def reference(self) -> Array | None:
        """Displacement that was asked for [m], where it was recorded."""
        return self.columns.get("reference_m")

    @property
    def command_voltage(self) -> Array | None:
        """What the amplifier was asked for [V], where it was recorded."""
        return self.columns.get("command_voltage_V")

    @functools.cached_property
    def sha256(self) -> str:
        """Fingerprint of the data (column names and samples): the same out of a CSV file and out of a bag."""
        if self.fingerprint:
            return self.fingerprint
        digest = hashlib.sha256()
        for key, values in self.columns.items():
            digest.update(f"{key}:{len(values)};".encode())
            digest.update(values.astype("<f8", copy=False).tobytes())
        return digest.hexdigest()

    def between(self, start_s: float, end_s: float) -> Record:
        """The samples with start_s <= time <= end_s [s]; BenchError where fewer than two remain."""
        first, last = np.searchsorted(self.time, [start_s, end_s], side="left")
        last += int(last < len(self) and self.time[last] == end_s)
        if last - first < 2:
            raise BenchError(
                f"{self.name}: {max(0, last - first)} samples between {start_s:.6g} s and {end_s:.6g} s; "
                f"the record runs from {self.time[0]:.6g} s to {self.time[-1]:.6g} s, choose a span with at least 2"
            )
        return Record(self.name, {key: values[first:last] for key, values in self.columns.items()}, self.warnings)


def read_csv(path: str | Path, required: Sequence[str] = RUN_COLUMNS) -> Record:
    """Read a measured run; nothing in it is repaired.

    Args:
        path: a CSV file with a header row of names with units, comma-separated, SI numbers.
        required: the columns that must be there.

    Raises:
        BenchError: one line that names the file, the row (the header is row 1), the column, what was found, what to do.
    """
    text = _text_of(Path(path))
    header_line, _, body = text.partition("\n")
    header = _header_of(str(path), header_line, required)
    known = [name for name in header if name in KNOWN_COLUMNS or name in required]
    places = [header.index(name) for name in known]
    table = _parse_fast(body, len(header), places)
    if table is None or not _is_sound(table, known.index("time_s")):
        table = _parse_strictly(str(path), text, header, known)
    if len(table) < 2:
        raise BenchError(f"{path}: {len(table)} row(s) of samples below the header; a run needs at least 2")
    columns = {name: table[:, index].copy() for index, name in enumerate(known)}
    ordered = {"time_s": columns["time_s"], **columns}
    return Record(str(path), ordered, tuple(_warnings(str(path), header, known, text)))


def write_csv(record: Record, path: str | Path) -> None:
    """Write a record so that reading it back gives the same bits; parent folders are made.

    Raises:
        BenchError: a sample is not finite (no reader would take the file), or the file cannot be written.
    """
    for column, values in record.columns.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise BenchError(
                f"{record.name}: sample {bad[0] + 1} of {column} is {values[bad[0]]}; only finite numbers are written"
            )
    write_table(path, list(record.columns), list(record.columns.values()))


def write_table(path: str | Path, header: Sequence[str], columns: Sequence[Array]) -> None:
    """Write columns of numbers as CSV, each the shortest text that reads back to the same bits."""
    row_format = ",".join(["%r"] * len(columns)) + "\n"

    def lines() -> Iterator[str]:
        yield ",".join(header) + "\n"
        for start in range(0, len(columns[0]), _ROWS_PER_WRITE):
            part = [column[start : start + _ROWS_PER_WRITE].tolist() for column in columns]
            yield "".join(map(row_format.__mod__, zip(*part, strict=True)))

    write_text(path, lines())


def write_text(path: str | Path, pieces: Iterable[str]) -> None:
    """Write a text file whole or not at all, parent folders included; BenchError where it cannot be written."""
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not path.is_file():  # a device such as /dev/stdout must not be replaced by a file
            with path.open("w", encoding="utf-8", newline="") as stream:
                stream.writelines(pieces)
            return
        unfinished = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        try:
            with unfinished.open("w", encoding="utf-8", newline="") as stream:
                stream.writelines(pieces)
            os.replace(unfinished, path)
        finally:
            unfinished.unlink(missing_ok=True)
    except OSError as error:
        raise BenchError(f"{path}: cannot write: {error.strerror}; choose another place or make room") from None


def _text_of(path: Path) -> str:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise BenchError(f"{path}: no such file; check the path") from None
    except IsADirectoryError:
        raise BenchError(f"{path}: is a directory, expected a CSV file; name the file in it") from None
    except OSError as error:
        raise BenchError(f"{path}: cannot read: {error.strerror}; check the file and its permissions") from None
    if not data.strip():
        raise BenchError(f"{path}: the file is empty; expected a header row with {','.join(RUN_COLUMNS)} and numbers")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = data.count(b"\n", 0, error.start) + 1
        raise BenchError(
            f"{path} row {row}: byte 0x{data[error.start]:02x} is not UTF-8 text; export the run as CSV in UTF-8"
        ) from None
    if "\0" in text:
        row = text.count("\n", 0, text.index("\0")) + 1
        raise BenchError(f"{path} row {row}: a zero byte, so this is no text file; export the run as CSV in UTF-8")
    return text.replace("\r\n", "\n")


def _header_of(path: str, line: str, required: Sequence[str]) -> list[str]:
    try:
        header = [cell.strip() for cell in next(csv.reader([line]), [])]
    except csv.Error as error:
        raise BenchError(f"{path} row 1: {_shortened(str(error))}; export the run as plain CSV") from None
    for name in header:
        if name and header.count(name) > 1:
            raise BenchError(
                f"{path} row 1: column {_shortened(name)} stands {header.count(name)} times; keep one of them"
            )
    for name in ("time_s", *required):
        if name not in header:
            found = _shortened(",".join(header))
            raise BenchError(
                f"{path} row 1: column {name} is missing, found '{found}'; the first row names the columns with units, "
                f"separated by commas, and needs {','.join(required)}"
            )
    return header


def _parse_fast(body: str, width: int, places: list[int]) -> Array | None:
    """The columns at `places` [shape (n, len(places))], or None where the strict parser has to look."""
    if not body.strip():
        return None
    body = body.rstrip("\n") + "\n"
    characters = np.frombuffer(body.encode(), dtype=np.uint8)
    line_ends = np.flatnonzero(characters == ord("\n"))
    commas = np.flatnonzero(characters == ord(","))
    if '"' in body or not _is_rectangular(commas, line_ends, width):
        return None
    try:
        table = np.loadtxt(io.StringIO(body), delimiter=",", comments=None, usecols=places, ndmin=2)
    except ValueError:
        return None
    return table if len(table) == len(line_ends) else None  # loadtxt skips empty lines


def _is_rectangular(commas: NDArray[np.intp], line_ends: NDArray[np.intp], width: int) -> bool:
    """Whether every line has `width` cells, from the places of its separators [characters from the start]."""
    if commas.size != line_ends.size * (width - 1):
        return False
    if commas.size == 0:
        return True
    by_line = commas.reshape(line_ends.size, width - 1)
    return bool(np.all(by_line[:, -1] < line_ends) and np.all(by_line[1:, 0] > line_ends[:-1]))


def _is_sound(table: Array, time_place: int) -> bool:
    return bool(np.all(np.isfinite(table)) and np.all(np.diff(table[:, time_place]) > 0.0))


def _parse_strictly(path: str, text: str, header: list[str], known: list[str]) -> Array:
    """The same table cell by cell; raises BenchError at the first row that is not right."""
    reader = csv.reader(io.StringIO(text.rstrip("\n")), strict=True)
    rows: list[list[float]] = []
    places = [(name, header.index(name)) for name in known]
    time_place = known.index("time_s")
    last_row = text.rstrip("\n").count("\n") + 1
    try:
        next(reader)
        for cells in reader:
            row = reader.line_num
            if len(cells) != len(header):
                cut_off = row == last_row and len(cells) < len(header)
                advice = "this last row is cut off, copy the file anew or remove the row" if cut_off else "mend the row"
                found = _shortened(",".join(cells))
                raise BenchError(
                    f"{path} row {row}: {len(cells)} cell(s) where the header has {len(header)}, found '{found}'; "
                    f"{advice}"
                )
            values = [_number(path, row, name, cells[place]) for name, place in places]
            if rows and not values[time_place] > rows[-1][time_place]:
                raise BenchError(
                    f"{path} row {row}: time_s {values[time_place]!r} is not after {rows[-1][time_place]!r} of the "
                    "sample before; time must increase from row to row, sort or cut the run"
                )
            rows.append(values)
    except csv.Error as error:
        raise BenchError(f"{path} row {reader.line_num}: {error}; export the run as plain CSV") from None
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(known))


def _number(path: str, row: int, column: str, cell: str) -> float:
    where = f"{path} row {row}, column {column}"
    if not cell.strip():
        raise BenchError(f"{where}: the cell is empty; fill it in or remove the row")
    try:
        value = float(cell)
        if "_" in cell:  # Python takes 1_000 for a number, no other program does
            raise ValueError
    except ValueError:
        raise BenchError(f"{where}: '{_shortened(cell)}' is not a number; write it like 1.5e-6") from None
    if not np.isfinite(value):
        raise BenchError(f"{where}: '{cell.strip()}' is not a finite number; remove the row or mend the value")
    return value


def _warnings(path: str, header: list[str], known: list[str], text: str) -> Iterator[str]:
    unknown = [_shortened(name) or "(no name)" for name in header if name not in known]
    if unknown:
        yield f"{path}: column(s) {', '.join(unknown)} ignored; known are {', '.join(KNOWN_COLUMNS)}"
    if not text.endswith("\n"):
        yield f"{path}: the last row has no line end; if the file was cut off, its last number may be wrong"


def _shortened(text: str) -> str:
    text = text if text.isprintable() else repr(text)[1:-1]  # an error is one line, whatever the cell holds
    return text if len(text) <= 60 else text[:57] + "..."
