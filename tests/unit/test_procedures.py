"""The thesis' experiments: turns and times against appendix B, drive and graph, and the actuator p802 under them."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pzt_ros.chains import load_chain, shipped
from pzt_ros.cli.app import build
from pzt_ros.errors import BenchError
from pzt_ros.experiments.experiment import Experiment
from pzt_ros.experiments.procedures import FAMILIES, Procedure, procedure
from pzt_ros.physics.link import ACTUATOR
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.physics.structure import Structure
from pzt_ros.records import read_csv
from pzt_ros.scenario import load_scenario

# Appendix B.2 of the thesis: v_setpoints by type, with rev_point = 20 V and v_start = 150 V
SETPOINTS = {
    "full-loop": [-150, 150],
    "type1": [20, 150],
    "type2": [-40, 20, -40],
    "type3": [20, 70, 20],
    "type4": [-40, 20, -30, 20],
    "relaxation": [20],
}


def whole_drive(experiment: Procedure, rate: float) -> tuple[np.ndarray, np.ndarray]:
    blocks = list(experiment.drive(rate))
    return np.concatenate([t for t, _ in blocks]), np.concatenate([v for _, v in blocks])


def chosen(family: str, rate: str) -> Procedure:
    return procedure(family, rate, reversal=None if family == "full-loop" else "20 V")


def test_setpoints_are_the_scripts() -> None:
    assert {family: list(chosen(family, "1 Hz").turns) for family in FAMILIES} == SETPOINTS


def test_reversal_points_are_the_scripts() -> None:
    assert FAMILIES["type1"].reversals == FAMILIES["type3"].reversals == (-40, -20, 0, 20, 50, 100)
    assert FAMILIES["type2"].reversals == (-20, 0, 20, 50, 100, 150)
    assert FAMILIES["type4"].reversals == (20, 50, 100, 150)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("rate", ["0.1 Hz", "1 kV/mm/s"])
def test_drive_goes_through_every_turn_at_its_time(family: str, rate: str) -> None:
    """5 s up, 10 s hold, each leg half a period or its way over the slope, 10 s hold, 5 s back (script: stoptime)."""
    time, voltage = whole_drive(chosen(family, rate), 1e3)
    expected_times, expected_voltages = [0.0, 5.0, 15.0], [0.0, 150.0, 150.0]
    for turn in SETPOINTS[family]:
        leg = 5.0 if rate == "0.1 Hz" else abs(turn - expected_voltages[-1]) / 100.0
        expected_times.append(expected_times[-1] + leg)
        expected_voltages.append(turn)
    expected_times += [expected_times[-1] + 10.0, expected_times[-1] + 15.0]
    expected_voltages += [expected_voltages[-1], 0.0]
    at = np.searchsorted(time, np.array(expected_times) - 1e-9)
    np.testing.assert_allclose(time[at], expected_times, rtol=0, atol=1e-9)
    np.testing.assert_allclose(voltage[at], expected_voltages, rtol=0, atol=1e-9)
    assert time[-1] == pytest.approx(expected_times[-1])
    assert np.all(np.diff(time) > 1e-7)
    assert voltage.max() <= 150.0 + 1e-9


def test_turns_between_two_samples_are_not_cut_off() -> None:
    time, voltage = whole_drive(procedure("type1", "33 Hz", reversal="-40 V"), 1e3)
    turn = int(np.argmin(voltage))
    assert voltage[turn] == -40.0
    assert time[turn] == pytest.approx(15 + 0.5 / 33, abs=1e-12)


def test_half_sine_is_the_scripts_cosine_and_a_line_has_the_rate() -> None:
    time, voltage = whole_drive(procedure("full-loop", "1 Hz"), 2e3)
    part = (time > 15) & (time < 16)
    np.testing.assert_allclose(voltage[part], 150 * np.cos(2 * np.pi * (time[part] - 15)), rtol=0, atol=1e-9)
    time, voltage = whole_drive(procedure("full-loop", "1 kV/mm/s"), 1e3)
    part = (time > 15) & (time < 18)
    np.testing.assert_allclose(np.gradient(voltage[part], time[part])[1:-1], -100.0, rtol=1e-9)


@pytest.mark.parametrize("family", FAMILIES)
def test_graph_and_drive_say_the_same(family: str) -> None:
    """The experiment node's references are the drive, sample for sample, when phases fill whole blocks."""
    experiment, size, rate = chosen(family, "10 Hz"), 100, 2e3
    conductor = Experiment(experiment.phases(), rate, size)
    references = []
    while (reference := conductor.step(len(references), 0.0, 0.0)) is not None:
        references.append(reference)
    in_graph = np.concatenate([reference.values for reference in references])
    time, voltage = whole_drive(experiment, rate)
    np.testing.assert_allclose(time[1:], np.arange(1, in_graph.size + 1) / rate, rtol=0, atol=1e-9)
    np.testing.assert_allclose(in_graph, voltage[1:], rtol=0, atol=1e-9)


@pytest.mark.parametrize("family", FAMILIES)
def test_shipped_scenario_is_the_experiment(family: str) -> None:
    scenario = load_scenario(family)
    assert family in shipped("scenarios")
    reversal = {"full-loop": None, "type1": "-40 V", "type2": "50 V", "type4": "50 V"}.get(family, "-20 V")
    assert scenario.phases == procedure(family, "1 Hz", reversal=reversal).phases()
    assert scenario.limits.voltage_min <= min(procedure(family, "1 Hz", reversal=reversal).turns)


def test_scenario_line_with_a_mistake_names_the_place(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    for line, complaint in (
        ("{experiment: type9}", "phase 1: no experiment 'type9'"),
        ("{experiment: type1, speed: 1 Hz}", "phase 1: unknown key 'speed'"),
        ("{experiment: type1, reversal: -200 V}", "phase 1: type1: reversal -200 V leads to -200 V"),
    ):
        path.write_text(f"plant: p802\nmodel: thesis-p2\nphases:\n  - {line}\n")
        with pytest.raises(BenchError, match=complaint):
            load_scenario(path)


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        (("type7",), "no experiment 'type7'; there are full-loop"),
        (("type1", "fast"), "neither a frequency nor a slope"),
        (("type1", "0 Hz"), "not above 0"),
        (("type1", "1 Hz", "linear"), "does not fit the form linear"),
        (("type1", "1 Hz", "square"), "no form 'square'"),
        (("type1", "1 Hz", None, "20"), "has no unit"),
        (("type3", "1 Hz", None, "120 V"), "leads to 170 V, the limit is"),
        (("full-loop", "1 Hz", None, "20 V"), "takes no reversal voltage"),
    ],
)
def test_refusals(values: tuple[str, ...], complaint: str) -> None:
    with pytest.raises(BenchError, match=complaint):
        procedure(*values)


def test_units_of_the_rate() -> None:
    assert procedure("type1", "0.1 kV/mm/s").rate == pytest.approx(10.0)
    assert procedure("type1", "10 V/s") == procedure("type1", "0.1 MV/m/s")
    assert procedure("type1", "250 mHz").rate == 0.25
    assert procedure("type1").form == "half-sine"
    assert procedure("type1", form="linear").rate == pytest.approx(10.0)


def test_safe_range_of_table_2_2() -> None:
    for family, rate in (("full-loop", "1 Hz"), ("full-loop", "1 kV/mm/s"), ("type3", "100 Hz"), ("type1", "10 kV/s")):
        assert procedure(family, rate).warning == ""
    assert "table 2.2" in procedure("full-loop", "4 Hz").warning
    assert "full range" in procedure("type1", "10 Hz", reversal="-60 V").warning


def test_simulate_a_named_experiment(tmp_path: Path) -> None:
    out = tmp_path / "run.csv"
    arguments = ["type3", "--rate", "10 Hz", "--reversal", "-20 V", "--sample-rate", "400 Hz"]
    result = CliRunner().invoke(build(), ["simulate", *arguments, "--model", "thesis-p2", "--out", str(out)])
    assert result.exit_code == 0, result.output
    run = read_csv(out)
    assert run.time[-1] == pytest.approx(30.15)
    assert run.voltage.min() == -20.0
    assert run.displacement[np.searchsorted(run.time, 15.0)] > 1e-5


@pytest.mark.parametrize("extra", [["--rate", "1 Hz"], ["--sample-rate", "1 kHz"]])
def test_options_of_experiments_do_not_go_with_a_file(tmp_path: Path, extra: list[str]) -> None:
    drive = tmp_path / "drive.csv"
    drive.write_text("time_s,voltage_V\n0,0\n1,10\n")
    arguments = ["simulate", str(drive), "--model", "thesis-p2", "--out", str(tmp_path / "o.csv"), *extra]
    with pytest.raises(BenchError, match="belongs to a named experiment"):
        CliRunner().invoke(build(), arguments, catch_exceptions=False)


# The actuator of chapter 2, without amplifier and sensor


@dataclass(frozen=True)
class Run:
    """Polarization [C/m^2] and strain [-] over voltage; `ends` are the samples at which the phases end."""

    time: np.ndarray
    voltage: np.ndarray
    polarization: np.ndarray
    strain: np.ndarray
    ends: np.ndarray

    def leg(self, phase: int) -> slice:
        return slice(self.ends[phase - 1], self.ends[phase] + 1)


POLING_HOLD, FIRST_LEG, SECOND_LEG = 1, 2, 3


@functools.cache
def p802(family: str, rate: str, reversal: str | None = None) -> Run:
    """100 samples a leg, the holds denser at their beginning, up to the end of the second hold."""
    chain = load_chain("p802").section(ACTUATOR)
    flexible = [link for link in chain.links if isinstance(link, Structure)]
    assert len(flexible) == 1  # its mode of 55 kHz is rigid at these rates, and needs samples that show it
    rigid = dataclasses.replace(chain, links=tuple(link for link in chain.links if link not in flexible))
    time, voltage, ends = [0.0], [0.0], []
    for phase in procedure(family, rate, reversal=reversal).phases()[:-1]:
        parts = np.geomspace(1e-4, 1, 50) if phase.to == voltage[-1] else np.arange(1, 101) / 100
        values = phase.value(voltage[-1], phase.length * parts)
        time, voltage = [*time, *(time[-1] + phase.length * parts)], [*voltage, *values]
        ends.append(len(time) - 1)
    t, v = np.array(time), np.array(voltage)
    _, out = rigid.step(rigid.init(Rest()), Signals(t, v))
    return Run(t, v, out.polarization, out.displacement / 8e-3, np.array(ends))


def test_p802_extends_as_measured() -> None:
    """13.3 um at 150 V (thesis 2.1.2)."""
    run = p802("type1", "0.1 Hz", "-40 V")
    assert 8e-3 * run.strain[run.ends[POLING_HOLD]] == pytest.approx(13.3e-6, rel=0.03)


@pytest.mark.parametrize(("rate", "polarization", "percent"), [("0.1 Hz", 0.12, 0.02), ("100 Hz", 0.16, 0.035)])
def test_p802_at_the_lowest_voltage(rate: str, polarization: float, percent: float) -> None:
    """The largest actuator loop comes down to these (thesis 2.2.3, type 1)."""
    run = p802("type1", rate, "-40 V")
    lowest = run.ends[FIRST_LEG]
    assert run.voltage[lowest] == -40.0
    assert run.polarization[lowest] == pytest.approx(polarization, rel=0.1)
    assert 100 * run.strain[lowest] == pytest.approx(percent, rel=0.1)


def test_p802_switches_back_fastest_where_the_thesis_says() -> None:
    """At about 0.4 kV/mm on the way up (2.2.3)."""
    run = p802("type1", "0.1 Hz", "-40 V")
    up = run.leg(SECOND_LEG)
    slope = np.gradient(run.polarization[up], run.voltage[up])[1:-1]
    assert run.voltage[up][1:-1][np.argmax(slope)] == pytest.approx(40.0, abs=10.0)


def test_p802_draws_the_current_of_the_full_loop() -> None:
    """0.6 mA at 0.1 Hz (2.2.2), within a factor 1.5."""
    run = p802("full-loop", "0.1 Hz")
    legs = slice(run.ends[POLING_HOLD], run.ends[SECOND_LEG] + 1)
    current = 2e-3 * np.diff(run.polarization[legs]) / np.diff(run.time[legs])
    assert 0.4e-3 < np.max(np.abs(current)) < 0.9e-3


def test_p802_loops_widen_with_the_rate() -> None:
    """Conclusion 1 of chapter 2: the coercive field rises with the rate."""
    down = [(run.polarization[run.leg(FIRST_LEG)], run.voltage[run.leg(FIRST_LEG)]) for run in map(full_loop, (0.1, 1))]
    slow, fast = (np.interp(0.0, -polarization, voltage) for polarization, voltage in down)
    assert fast < slow - 1.0


def full_loop(hertz: float) -> Run:
    return p802("full-loop", f"{hertz} Hz")


def test_p802_strain_over_polarization_is_a_loop_at_both_rates() -> None:
    """Figure 2.4b: at the same P the descending branch strains less, and 1 Hz does it almost exactly as 0.1 Hz."""
    p = np.linspace(0.05, 0.2, 16)
    widths = []
    for run in (full_loop(0.1), full_loop(1)):
        down, up = run.leg(FIRST_LEG), run.leg(SECOND_LEG)
        descending = np.interp(-p, -run.polarization[down], run.strain[down])
        widths.append(np.interp(p, run.polarization[up], run.strain[up]) - descending)
    assert np.all(widths[0] > 1e-5)
    np.testing.assert_allclose(widths[1], widths[0], rtol=0.05)


def test_p802_relaxes_to_one_level_and_takes_its_time() -> None:
    """Conclusion 4 and figure 2.17: from different starts to the same strain, still moving after a second."""
    slow, fast = (p802("relaxation", rate, "-20 V") for rate in ("0.1 Hz", "100 Hz"))
    start, end = slow.ends[FIRST_LEG], slow.ends[FIRST_LEG + 1]
    apart = fast.strain[start] - slow.strain[start]
    assert apart > 1e-4
    assert abs(fast.strain[end] - slow.strain[end]) < 0.02 * apart
    after_second = np.interp(slow.time[start] + 1.0, slow.time, slow.strain)
    assert after_second - slow.strain[end] > 0.2 * (slow.strain[start] - slow.strain[end])


def test_p802_hardly_relaxes_at_the_highest_voltage() -> None:
    """Very little is left to switch at 150 V (2.2.3, type 1)."""
    run = p802("type1", "100 Hz", "-40 V")
    before, after = run.strain[run.ends[-2]], run.strain[run.ends[-1]]
    assert 0 < after - before < 0.005 * before


def test_p802_shuttles_get_thinner_towards_higher_fields() -> None:
    """Types 3 and 4: a minor loop of 0.5 kV/mm is narrower the higher its reversal field (2.2.3)."""
    areas = []
    for reversal in FAMILIES["type3"].reversals:
        run = p802("type3", "0.1 Hz", f"{reversal} V")
        loop = slice(run.ends[FIRST_LEG], run.ends[-2] + 1)
        areas.append(np.trapezoid(run.voltage[loop], run.polarization[loop]))
    assert np.all(np.diff(areas[:-1]) < 0)  # from -40 to 50 V; the last one reaches saturation
    assert min(areas) > 0
    assert areas[-1] < 0.05 * areas[0]
