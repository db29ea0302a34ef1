"""Records and their CSV form: bit-exact round trips, and one line for everything that is wrong with a file."""

from __future__ import annotations

import csv
import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest

from pzt_ros import records
from pzt_ros.errors import BenchError
from pzt_ros.records import Record, read_csv, write_csv

HEAD = "time_s,voltage_V,displacement_m\n"
ROWS = "0,1.5,1e-6\n0.1,2.5,2e-6\n0.2,3.5,3e-6\n"


def write(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def check_one_line(text: str, *parts: str) -> None:
    assert text.isprintable(), text
    for part in parts:
        assert part in text, text


def awkward_record(count: int = 500) -> Record:
    """Numbers that lose bits in any format that is not exact: denormals, extremes, uneven times."""
    rng = np.random.default_rng(7)
    bits = rng.integers(0, 2**63, size=(3, count), dtype=np.int64).view(np.float64)
    bits[~np.isfinite(bits)] = np.pi
    bits[0, :4] = [5e-324, 1.7976931348623157e308, 0.1, -0.0]
    time = np.cumsum(rng.random(count)) - 3.0
    names = ("voltage_V", "displacement_m", "temperature_K")
    return Record("awkward", {"time_s": time, **dict(zip(names, bits, strict=True))})


def test_round_trip_is_exact_to_the_bit(tmp_path: Path) -> None:
    record = awkward_record()
    write_csv(record, tmp_path / "new" / "folder" / "run.csv")
    back = read_csv(tmp_path / "new" / "folder" / "run.csv")
    assert list(back.columns) == list(record.columns)
    for name, values in record.columns.items():
        assert back.columns[name].tobytes() == values.tobytes(), name
    assert back.sha256 == record.sha256
    assert back.warnings == ()
    assert os.listdir(tmp_path / "new" / "folder") == ["run.csv"]


def test_written_file_reads_the_same_with_the_csv_module(tmp_path: Path) -> None:
    record = awkward_record(20)
    write_csv(record, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    for name, values in record.columns.items():
        assert [float(row[name]) for row in rows] == values.tolist()


def test_fast_and_strict_parser_give_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.csv"
    write_csv(awkward_record(), path)
    fast = read_csv(path)
    calls = []
    monkeypatch.setattr(records, "_parse_fast", lambda *_: calls.append(1))
    assert read_csv(path).sha256 == fast.sha256
    assert calls == [1]


def test_sha256_tells_any_change() -> None:
    record = awkward_record()
    voltage = record.voltage.copy()
    voltage[250] = np.nextafter(voltage[250], np.inf)
    changed = dataclasses.replace(record, columns={**record.columns, "voltage_V": voltage})
    renamed = Record("x", {name.replace("temperature_K", "force_N"): v for name, v in record.columns.items()})
    assert len({record.sha256, changed.sha256, renamed.sha256}) == 3


def test_attributes_and_span() -> None:
    time = np.array([0.0, 0.5, 0.6, 2.0, 3.0])
    record = Record("run", {"time_s": time, "voltage_V": time * 10, "displacement_m": time * 1e-6})
    assert record.polarization is None
    assert record.reference is None
    assert record.command_voltage is None
    np.testing.assert_array_equal(record.between(0.5, 2.0).voltage, [5.0, 6.0, 20.0])
    np.testing.assert_array_equal(record.between(-1.0, 0.55).time, [0.0, 0.5])
    np.testing.assert_array_equal(record.between(0.1, 9.0).time, time[1:])
    for start, end in ((0.7, 1.9), (5.0, 6.0), (2.0, 1.0), (-5.0, 0.0)):
        with pytest.raises(BenchError, match="runs from 0 s to 3 s"):
            record.between(start, end)
    drive = Record("drive.csv", {"time_s": time, "voltage_V": time})
    with pytest.raises(BenchError, match=r"drive\.csv: no column displacement_m"):
        _ = drive.displacement


@pytest.mark.parametrize("names", [("voltage_V", "time_s"), ()])
def test_record_wants_time_first(names: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="time_s"):
        Record("x", {name: np.arange(3.0) for name in names})


def test_record_wants_columns_of_one_length() -> None:
    with pytest.raises(ValueError, match="one length"):
        Record("x", {"time_s": np.arange(3.0), "voltage_V": np.arange(4.0)})


def test_known_columns_in_any_order_and_unknown_ones_named(tmp_path: Path) -> None:
    text = 'note,displacement_m,current_A,time_s,voltage_V,gain\nok,1e-6,0.1,0,1,x\n"a,b",2e-6,0.2,0.5,2,y\n'
    record = read_csv(write(tmp_path / "run.csv", text))
    assert list(record.columns) == ["time_s", "displacement_m", "current_A", "voltage_V"]
    assert record.current is not None
    np.testing.assert_array_equal(record.current, [0.1, 0.2])
    np.testing.assert_array_equal(record.time, [0.0, 0.5])
    assert len(record.warnings) == 1
    assert "note, gain ignored" in record.warnings[0]
    assert "run.csv" in record.warnings[0]


@pytest.mark.parametrize(
    "text",
    [
        HEAD + ROWS,
        "\ufeff" + HEAD + ROWS,
        (HEAD + ROWS).replace("\n", "\r\n"),
        HEAD + ROWS + "\n\n",
        "time_s, voltage_V , displacement_m\n" + ROWS.replace(",", ", "),
    ],
    ids=["plain", "byte order mark", "DOS line ends", "empty lines at the end", "spaces"],
)
def test_harmless_forms_are_read(tmp_path: Path, text: str) -> None:
    record = read_csv(write(tmp_path / "run.csv", text))
    np.testing.assert_array_equal(record.displacement, [1e-6, 2e-6, 3e-6])
    assert record.warnings == ()


def test_missing_line_end_is_a_warning(tmp_path: Path) -> None:
    record = read_csv(write(tmp_path / "run.csv", (HEAD + ROWS)[:-1]))
    assert len(record) == 3
    assert "no line end" in record.warnings[0]


def test_drive_needs_no_displacement(tmp_path: Path) -> None:
    path = write(tmp_path / "drive.csv", "time_s,voltage_V\n0,0\n1,100\n")
    assert read_csv(path, required=("time_s", "voltage_V")).voltage.tolist() == [0.0, 100.0]
    with pytest.raises(BenchError, match=r"drive\.csv row 1: column displacement_m is missing"):
        read_csv(path)


BAD_FILES = {
    "empty": ("", ["empty"]),
    "blank": ("\n \n", ["empty"]),
    "header only": (HEAD, ["0 row(s)"]),
    "header only, no line end": (HEAD[:-1], ["0 row(s)"]),
    "one sample": (HEAD + "0,1,2\n", ["1 row(s)", "at least 2"]),
    "missing column": ("time_s,voltage\n0,1\n1,2\n", ["row 1", "voltage_V is missing", "'time_s,voltage'"]),
    "semicolons": (HEAD.replace(",", ";") + "0;1;2\n", ["row 1", "time_s is missing", "separated by commas"]),
    "no header": (ROWS, ["row 1", "time_s is missing", "'0,1.5,1e-6'"]),
    "duplicated column": ("time_s,voltage_V,voltage_V,displacement_m\n0,1,1,1\n", ["row 1", "voltage_V", "2 times"]),
    "duplicated unknown column": ("time_s,a,a,voltage_V,displacement_m\n0,1,1,1,1\n", ["row 1", "a stands", "2 times"]),
    "text": (HEAD + ROWS + "0.3,4V,1e-6\n", ["row 5", "voltage_V", "'4V'"]),
    "decimal comma": (HEAD + '0,1,1\n"0,1",1,1\n', ["row 3", "time_s", "'0,1'"]),
    "underscore": (HEAD + "0,1,1\n1,1_0,1\n", ["row 3", "voltage_V", "'1_0'"]),
    "hexadecimal": (HEAD + "0,1,1\n1,0x10,1\n", ["row 3", "voltage_V", "'0x10'"]),
    "control characters": (HEAD + "0,1,1\n1,1\x1b[31m,1\n", ["row 3", "voltage_V", "x1b"]),
    "NaN": (HEAD + "0,1,1\n1,nan,1\n2,1,1\n", ["row 3", "voltage_V", "'nan'"]),
    "infinity": (HEAD + "0,1,1\n1,1,-inf\n2,1,1\n", ["row 3", "displacement_m", "'-inf'"]),
    "overflow": (HEAD + "0,1,1\n1,1,1e999\n2,1,1\n", ["row 3", "displacement_m", "'1e999'"]),
    "empty cell": (HEAD + "0,1,1\n1,,1\n2,1,1\n", ["row 3", "voltage_V", "empty"]),
    "cell of spaces": (HEAD + "0,1,1\n1,  ,1\n2,1,1\n", ["row 3", "voltage_V", "empty"]),
    "too few cells": (HEAD + "0,1,1\n1,1\n2,1,1\n", ["row 3", "2 cell(s)", "'1,1'"]),
    "too many cells": (HEAD + "0,1,1\n1,1,1,9\n2,1,1\n", ["row 3", "4 cell(s)", "'1,1,1,9'"]),
    "too many and too few": (HEAD + "0,1,1\n1,1,1,9\n2,1\n", ["row 3", "4 cell(s)"]),
    "empty row": (HEAD + "0,1,1\n\n2,1,1\n", ["row 3", "0 cell(s)"]),
    "cut off": (HEAD + ROWS + "0.3,4.", ["row 5", "'0.3,4.'", "cut off"]),
    "cut off in a number": (HEAD + ROWS + "0.3,4.5,1e-", ["row 5", "displacement_m", "'1e-'"]),
    "time stands still": (HEAD + ROWS + "0.2,1,1\n0.3,1,1\n", ["row 5", "0.2 is not after 0.2"]),
    "time runs back": (HEAD + ROWS + "0.15,1,1\n", ["row 5", "time_s 0.15 is not after 0.2"]),
    "zero byte": (HEAD + "0,1,1\n1,\0,1\n", ["row 3", "zero byte"]),
    "not UTF-8": ((HEAD + "0,1,1\n1,").encode() + b"\xb5,1\n", ["row 3", "0xb5"]),
    "UTF-16": ((HEAD + ROWS).encode("utf-16"), ["row 1", "0xff"]),
    "binary": (bytes(range(256)) * 4, ["UTF-8"]),
    "old Mac line ends": ((HEAD + ROWS).replace("\n", "\r"), ["row 1"]),
    "broken quotes": (HEAD + '0,1,1\n1,"1"x,1\n2,1,1\n', ["row 3"]),
    "open quotes": (HEAD + '0,1,1\n1,"1,1\n2,1,1\n', ["row"]),
}


@pytest.mark.parametrize(("content", "found"), BAD_FILES.values(), ids=BAD_FILES.keys())
def test_bad_file_is_one_line(tmp_path: Path, content: str | bytes, found: list[str]) -> None:
    path = write(tmp_path / "bad_run.csv", content)
    with pytest.raises(BenchError) as caught:
        read_csv(path)
    check_one_line(str(caught.value), "bad_run.csv", *found)


def test_bad_row_deep_in_a_long_file_is_found(tmp_path: Path) -> None:
    lines = [f"{i * 1e-3!r},{i % 150},1e-6" for i in range(20_000)]
    lines[17_654] = "17.654,abc,1e-6"
    with pytest.raises(BenchError, match=r"row 17656, column voltage_V: 'abc'"):
        read_csv(write(tmp_path / "run.csv", HEAD + "\n".join(lines) + "\n"))


def test_empty_row_of_a_single_column_is_found(tmp_path: Path) -> None:
    with pytest.raises(BenchError, match="row 3: 0 cell"):
        read_csv(write(tmp_path / "times.csv", "time_s\n0\n\n1\n2\n"), required=("time_s",))


def test_missing_file_and_directory(tmp_path: Path) -> None:
    with pytest.raises(BenchError, match=r"nowhere\.csv: no such file"):
        read_csv(tmp_path / "nowhere.csv")
    with pytest.raises(BenchError, match="is a directory"):
        read_csv(tmp_path)


def test_every_cut_of_a_file_is_read_or_named(tmp_path: Path) -> None:
    """Wherever a file is cut: an error of one line, or rows of the original and a word about the missing line end."""
    text = HEAD + ROWS
    whole = read_csv(write(tmp_path / "run.csv", text))
    for end in range(len(text)):
        path = write(tmp_path / "cut.csv", text[:end])
        try:
            record = read_csv(path)
        except BenchError as error:
            check_one_line(str(error), "cut.csv")
            continue
        sure = len(record) - len(record.warnings)
        for name, values in record.columns.items():
            assert values[:sure].tolist() == whole.columns[name][:sure].tolist()
        assert record.warnings or text[end - 1] == "\n"


def test_unwritable_places_are_named(tmp_path: Path) -> None:
    record = awkward_record(4)
    (tmp_path / "file").write_text("x")
    for target in (tmp_path / "file" / "run.csv", tmp_path, Path("/proc/nowhere/run.csv")):
        with pytest.raises(BenchError, match="cannot write"):
            write_csv(record, target)
    assert (tmp_path / "file").read_text() == "x"


def test_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = write(tmp_path / "run.csv", "old")

    def pieces():
        yield "new"
        raise OSError(28, "No space left on device")

    with pytest.raises(BenchError, match="No space left"):
        records.write_text(path, pieces())
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["run.csv"]


def test_a_device_is_written_to_and_not_replaced() -> None:
    write_csv(awkward_record(4), os.devnull)
    assert not Path(os.devnull).is_file()


def test_numbers_that_are_not_finite_are_not_written(tmp_path: Path) -> None:
    record = Record("sim", {"time_s": np.arange(3.0), "voltage_V": np.array([0.0, np.nan, 1.0])})
    with pytest.raises(BenchError, match="sim: sample 2 of voltage_V is nan"):
        write_csv(record, tmp_path / "run.csv")
    assert not (tmp_path / "run.csv").exists()


MEASURED = sorted(Path("/work/shared/data").glob("*/*.csv"))


@pytest.mark.skipif(not MEASURED, reason="measured runs are not here")
@pytest.mark.parametrize("path", MEASURED, ids=lambda path: path.stem)
def test_measured_runs_are_read_as_by_numpy(path: Path) -> None:
    record = read_csv(path)
    table = np.genfromtxt(path, delimiter=",", names=True)
    for name, values in record.columns.items():
        np.testing.assert_array_equal(values, table[name])
