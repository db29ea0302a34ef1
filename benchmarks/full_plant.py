"""The stage with all that the plain tracking benchmark leaves out, followed with a model identified from noisy runs.

Everything is simulated. The amplifier has its limits and a Sawyer-Tower capacitor in series, the ceramic creeps behind
a flexure with a mode at 1 kHz, the stage grows warm and the sensor lags, with the thesis' noise and least step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pzt_benchmarks.table import MET, NOT_MET, Table
from pzt_benchmarks.tracking_rig import RATE, SENSOR, Rig, known_start
from pzt_ros.controllers.controller import Controller
from pzt_ros.controllers.inverse import Inverse
from pzt_ros.controllers.observer_inverse import ObserverInverse
from pzt_ros.controllers.open_loop import OpenLoop
from pzt_ros.effects.sensor_lag import SensorLag
from pzt_ros.effects.slow_relaxation import SlowRelaxation
from pzt_ros.effects.thermal_drift import ThermalDrift
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.front import Front
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.structure import Structure
from pzt_ros.quantities import parameters_of
from pzt_ros.records import Record
from pzt_ros.sysid.fit import Fit
from pzt_ros.sysid.result import FitResult

TREK = Amplifier(slew_rate=500e6, voltage_limit=350.0, current_limit=0.2, reference_capacitance=133.5e-6)
"""The thesis' amplifier (2.1), without compensation of the capacitor: that is left to the inverse."""

CERAMIC = Lattice(spacing=0.9, method="midpoint", accuracy=1e-4)

AMPLIFIER = Chain("amplifier", (TREK.driving(CERAMIC),))
PLANT = Chain(
    "full plant",
    (
        CERAMIC,
        Electrostriction(),
        SlowRelaxation(share=0.08, shortest_time=0.03, longest_time=4.0),
        Structure(resonance_frequency=1000.0, damping_ratio=0.02),
        ThermalDrift(rate=2e-8, time_constant=60.0),
    ),
)
"""What moves; the truth is at its end."""

SENSOR_CHAIN = Chain("sensor", (SensorLag(lag=20e-6, delay_share=0.0), SENSOR))
"""A bandwidth of 8 kHz, then noise and least step."""

FREE = {
    "front": (
        "coercive_field", "coercive_field_spread", "interaction_field_spread", "relaxation_time",
        "reciprocal_permittivity",
    ),
    "electrostriction": ("coefficient",),
    "slow_relaxation": ("share", "shortest_time", "longest_time"),
    "structure": ("resonance_frequency", "damping_ratio"),
    "sensor_lag": ("lag",),
    "thermal_drift": ("rate",),
}  # fmt: skip
"""What is looked for. The domain's polarization and volume cannot be told from displacement alone."""

GUESS = Chain(
    "what is known beforehand",
    (
        Front(
            coercive_field=0.45e6, coercive_field_spread=6e11, interaction_field_spread=4e11, relaxation_time=2e-3,
            reciprocal_permittivity=5e7,
        ),
        Electrostriction(coefficient=0.02),
        SlowRelaxation(share=0.02, shortest_time=0.1, longest_time=2.0),
        Structure(resonance_frequency=900.0, damping_ratio=0.05),
        SensorLag(lag=5e-6, delay_share=0.0),
        ThermalDrift(time_constant=60.0),
        SENSOR,
    ),
    {"free": [f"{link}.{name}" for link, names in FREE.items() for name in names]},
)  # fmt: skip
"""Which links the stage has, and numbers that are 10 to 100 % off."""


def legs(levels: tuple[tuple[float, float], ...], rate: float) -> tuple[Array, Array]:
    """Times [s] and voltages [V] from 0 V through (voltage [V], duration [s]) in straight lines, at so many samples a
    second."""
    corners = np.cumsum([0.0, *(duration for _, duration in levels)])
    time: Array = np.arange(1.0, round(corners[-1] * rate) + 1.0) / rate
    return time, np.interp(time, corners, [0.0, *(voltage for voltage, _ in levels)])


SLOW = (
    (150.0, 1.0), (150.0, 0.5), (0.0, 1.0), (100.0, 0.5), (30.0, 0.5), (120.0, 0.5), (120.0, 2.0), (-30.0, 0.5),
    (60.0, 0.5), (60.0, 2.0), (150.0, 0.3), (20.0, 0.3), (110.0, 0.02), (110.0, 1.5), (50.0, 1.0), (50.0, 2.0),
    (0.0, 0.5),
)  # fmt: skip
"""Minor loops, and holds reached from below and from above; at 2 kHz."""

FAST = (
    (150.0, 0.05), (0.0, 0.05), *(((120.0, 0.01), (0.0, 0.01)) * 3), *(((130.0, 5e-3), (20.0, 5e-3)) * 4),
    *(((110.0, 3.3e-3), (30.0, 3.3e-3)) * 6), (40.0, 0.01), (50.0, 5e-4), (50.0, 0.06), (30.0, 5e-4), (30.0, 0.06),
    (100.0, 2e-3), (100.0, 0.05), (0.0, 0.02),
)  # fmt: skip
"""Triangles at 50, 100 and 150 Hz, and steps that ring; at 20 kHz."""


def measured(name: str, levels: tuple[tuple[float, float], ...], rate: float, seed: int) -> Record:
    """A run of the stage from its virgin state: voltage across the ceramic, and the sensor's reading."""
    rest = Rest(seed=seed)
    time, command = legs(levels, rate)
    signals = Signals(time, command)
    for part in (AMPLIFIER, PLANT, SENSOR_CHAIN):
        _, signals = part.step(part.init(rest), signals)
    columns = {"time_s": time, "voltage_V": signals.voltage, "displacement_m": signals.displacement}
    return Record(name, columns)


def identified(seed: int, tell: Callable[[str], None]) -> FitResult:
    """The model as two noisy open-loop runs have it, its ceramic as two fronts: a tenth of the lattice's time."""
    runs = [measured("slow", SLOW, 2e3, seed), measured("fast", FAST, RATE, seed + 1)]
    return Fit(GUESS, progress=lambda text: tell(f"identification: {text}")).fit(runs)


def to_control_with(found: Chain) -> Chain:
    """The identified model, without noise, behind the amplifier of the data sheet; its drift belonged to those runs.

    The lattice takes the place of the fronts: fronts are off by more where scans are fast.
    """
    ceramic = Lattice(
        spacing=0.8, method="midpoint", accuracy=1e-3, **{name: getattr(found.links[0], name) for name in FREE["front"]}
    )
    links = tuple(link.noiseless() for link in found.links[1:] if link.kind != ThermalDrift.kind)
    return Chain("identified", (TREK, ceramic, *links))


PUBLISHED = {5.0: 0.60, 30.0: 0.64, 50.0: 0.73, 90.0: 1.73, 150.0: 1.67}
"""Frequency [Hz] and rms error [%] of an experiment: inversion feed-forward of Zou et al. 2004, as they define it."""

CYCLES = {5.0: (2, 1), 30.0: (5, 2), 50.0: (6, 2), 90.0: (9, 4), 150.0: (14, 6)}
"""Cycles at each frequency, and those before it counts."""

LOW, STROKE = 2.5e-6, 8e-6
"""Of the scan [m]: from here the ceramic draws less than 0.2 A at 150 Hz."""

TURN = 0.1
"""Half of the time that a turn takes, of a cycle: a mode at 1 kHz cannot follow a corner."""


def rounded_triangle(frequency: float, cycles: float) -> Array:
    """A triangle whose turns have a raised cosine as acceleration [m]; it begins and ends at its lower turn."""
    cycle = (np.arange(1, round(cycles * RATE / frequency) + 1) * (frequency / RATE)) % 1.0
    since = np.minimum(cycle, 1.0 - cycle)
    path = np.where(since < 0.25, 2.0 * _rounded(since), 1.0 - 2.0 * _rounded(0.5 - since))
    lost = 2.0 * float(_rounded(np.zeros(1))[0])
    reference: Array = LOW + STROKE * (path - lost) / (1.0 - 2.0 * lost)
    return reference


def _rounded(distance: Array) -> Array:
    """The distance from a corner through a window (1 + cos) of half width TURN."""
    near = distance**2 / (2.0 * TURN) + TURN / 2.0
    near -= TURN / np.pi**2 * (1.0 + np.cos(np.pi * distance / TURN))
    return np.where(distance < TURN, near, distance)


@dataclass(frozen=True)
class Followed:
    """A controller on the full plant.

    Attributes:
        name: of it.
        rms: error by frequency [Hz: % of stroke].
        cycle: reference minus truth over the last cycle by frequency [Hz: %].
    """

    name: str
    rms: dict[float, float]
    cycle: dict[float, Array]


def followed(name: str, rig: Rig, frequencies: tuple[float, ...]) -> Followed:
    """One run through the frequencies, one after the other."""
    run = rig.follow(np.concatenate([rounded_triangle(f, CYCLES[f][0]) for f in frequencies]))
    error, begin = 100.0 * (run.reference - run.truth) / STROKE, 0
    rms, cycle = {}, {}
    for f in frequencies:
        cycles, skipped = CYCLES[f]
        end = begin + round(cycles * RATE / f)
        counted = error[begin + round(skipped * RATE / f) : end]
        rms[f], cycle[f] = float(np.sqrt(np.mean(counted**2))), error[end - round(RATE / f) : end]
        begin = end
    return Followed(name, rms, cycle)


def compare(quick: bool, tell: Callable[[str], None]) -> tuple[list[Followed], FitResult]:
    """Open loop, inverse and observer-based inverse on the full plant; `quick` leaves out all but 30 and 150 Hz."""
    found = identified(3, tell)
    model = to_control_with(found.chain)
    frequencies = (30.0, 150.0) if quick else tuple(PUBLISHED)
    sensitivity, at_zero = np.polyfit(*_slow_loop(), 1)
    line = OpenLoop(gain=float(sensitivity), voltage_at_zero=float(-at_zero / sensitivity))
    rigs: list[tuple[str, Controller]] = [
        ("linear open loop", line), ("inverse", Inverse()), ("observer-based", ObserverInverse())
    ]  # fmt: skip
    runs = []
    for name, controller in rigs:
        tell(f"full plant: {name}")
        observer = known_start() if isinstance(controller, ObserverInverse) else None
        rig = Rig(controller, model, observer, plant=PLANT, amplifier=AMPLIFIER, sensor=SENSOR_CHAIN)
        runs.append(followed(name, rig, frequencies))
    return runs, found


def _slow_loop() -> tuple[Array, Array]:
    """Voltage [V] and reading [m] of the slow run once it was poled: what a straight line is taken from."""
    run = measured("slow", SLOW, 2e3, 3)
    poled = run.time > 1.5
    return run.voltage[poled], run["displacement_m"][poled]


def tables(runs: list[Followed], found: FitResult) -> list[Table]:
    """Errors beside the published ones, and what was identified."""
    rows = []
    for f in runs[0].rms:
        best, aim = runs[-1].rms[f], 0.1 * PUBLISHED[f]
        errors = (f"{run.rms[f]:.3f}" for run in runs)
        rows.append((f"{f:g} Hz", *errors, f"{PUBLISHED[f]:.2f}", f"{aim:.3f}", MET if best <= aim else NOT_MET))
    note = (
        f"Rms error of the true displacement in percent of the {1e6 * STROKE:g} um stroke; simulated. Triangles whose"
        f" turns take {400 * TURN:g} % of the cycle in all. Published: inversion feed-forward, Zou et al. 2004, an"
        " experiment on another stage with another reference, for orientation. The aim is a tenth of it, for the"
        " observer-based inverse."
    )
    heads = ("scan", *(run.name for run in runs), "published", "aim", "aim reached")
    truth = {f"{link.kind}.{name}": getattr(link, name) for link in _TRUE for name in parameters_of(link)}
    known = [(e, truth[e.name.replace("front.", "lattice.")]) for e in found.estimates]
    identified = [(e.name, f"{e.value:.4g}", f"{e.std:.2g}", f"{true:.4g}", e.unit) for e, true in known]
    rms = ", ".join(f"{1e9 * run.rms:.0f} nm in the {run.name} run" for run in found.runs)
    identification = Table(
        "What was identified", ("parameter", "found", "std", "true", "unit"), identified,
        "From two noisy open-loop runs, with two fronts as the ceramic, starting 10 to 100 % off; left are"
        f" {rms}, of which 42 nm are the sensor's.",
    )  # fmt: skip
    return [Table("The full plant, with an identified model", heads, rows, note), identification]


_TRUE = (*PLANT.links, *SENSOR_CHAIN.links)
