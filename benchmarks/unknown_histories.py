"""`pzt bench observer`: stages whose history, offset and drift nobody told the observer; and `docs/observer.md`.

python -m pzt_benchmarks.unknown_histories --out docs      # writes docs/observer.md
"""

from __future__ import annotations

import argparse
import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pzt_benchmarks.report import provenance
from pzt_benchmarks.stopwatch import one_core
from pzt_benchmarks.table import Figure, Table, Target, figures_table, number
from pzt_benchmarks.tracking_rig import RATE, SENSOR, STROKE, stage
from pzt_ros.chains import load_model
from pzt_ros.observers.hysteresis import HysteresisObserver
from pzt_ros.observers.observer import Estimate
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.front import Front
from pzt_ros.physics.identified_lattice import IdentifiedLattice
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.signals import ABSENT, Array, Rest, Signals

DURATION, SETTLED, BLOCK = 1.2, 1.0, 500
"""Of a trial and until the observer has to have settled [s]; samples of a block."""

EARLY = 0.1
"""When half a cycle of the scan has told little of the history yet [s]."""

BAND = 1.96
"""Standard deviations on each side that hold 95 % of what is normal."""

CHARGE_NOISE = 1e-7
"""Of a charge meter [C]: 1e-4 of what the ceramic takes."""


BY_DISPLACEMENT = HysteresisObserver(members=48.0)
BY_CHARGE_TOO = HysteresisObserver(members=48.0, charge_noise_rms=CHARGE_NOISE)


@dataclass(frozen=True)
class Study:
    """Which stage is observed by which observer, and the share of the trials that it gets."""

    chain: Chain
    share: float
    observer: HysteresisObserver = BY_DISPLACEMENT


MODELS: dict[str, Study] = {
    "front": Study(stage(Front(), "front"), 1.0),
    "front, with charge": Study(stage(Front(), "front"), 0.1, BY_CHARGE_TOO),
    "parametrized": Study(load_model("thesis-p2"), 0.05),
    "lattice": Study(stage(Lattice(spacing=1.0, method="midpoint"), "lattice"), 0.004),
    "identified lattice": Study(stage(IdentifiedLattice(), "identified"), 0.004),
}


@dataclass(frozen=True)
class Trial:
    """One unknown history.

    Attributes:
        settled_after: last time at which the displacement was off by 1 % of the scan's own stroke or more [s].
        largest: error of displacement once settled [m].
        rms: of the displacement's error once settled [m].
        inside: shares of samples within the 95 % bands, of displacement, polarization, phase fraction [-].
        polarization_rms, early_polarization_rms: error once settled, and in the first EARLY [C/m^2].
        sample_time: of the observer [s].
    """

    settled_after: float
    largest: float
    rms: float
    inside: tuple[float, float, float]
    polarization_rms: float
    early_polarization_rms: float
    sample_time: float


def scan(random: np.random.Generator) -> tuple[Array, Array]:
    """Times [s] and voltages [V] of an ordinary scan at 5 Hz that begins somewhere."""
    low = random.uniform(0.0, 30.0)
    high = low + random.uniform(60.0, 110.0)
    time = np.arange(round(DURATION * RATE)) / RATE
    phase = random.uniform(0.0, 2.0 * np.pi)
    return time, low + (high - low) * 0.5 * (1.0 - np.cos(2.0 * np.pi * 5.0 * time + phase))


def history(random: np.random.Generator, voltage: float) -> tuple[Array, Array]:
    """Times up to 0 [s] and voltages [V] of up to 12 reversals at 10 V/s to 10 kV/s, some of them held, to `voltage`.

    Made otherwise than the observer makes up its own: more reversals, other rates, holds.
    """
    count = int(random.integers(1, 12))
    levels = np.concatenate(([0.0], random.uniform(-40.0, 150.0, count), [voltage]))
    ramps = np.abs(np.diff(levels)) / 10.0 ** random.uniform(1.0, 4.0, count + 1) + 1e-3
    holds = random.uniform(1e-3, 1.0, count + 1)
    steps = np.stack((ramps, holds), axis=1).ravel()
    ends = np.cumsum(steps) - steps.sum()
    return np.concatenate(([-steps.sum()], ends)) - 1.0 / RATE, np.concatenate(([0.0], np.repeat(levels[1:], 2)))


def trial(model: Chain, observer: HysteresisObserver, seed: int) -> Trial:
    """Observe one stage from an unknown start."""
    random = np.random.default_rng(seed)
    behind = model.behind_amplifier
    time, voltage = scan(random)
    past, levels = history(random, float(voltage[0]))
    state = behind.init(Rest(time=float(past[0])))
    state, _ = behind.step(state, Signals(past[1:], levels[1:]))
    _, true = behind.step(state, Signals(time, voltage))
    clean = true.displacement + random.uniform(-5e-6, 5e-6) + random.normal(0.0, 1e-8) * time
    noisy = clean + SENSOR.noise_rms * random.normal(size=time.size)
    reading = np.round(noisy / SENSOR.resolution) * SENSOR.resolution
    area = sum(link.electrode_area for link in behind.links if isinstance(link, Ferroelectric))
    charge = area * (true.polarization - true.polarization[0]) + CHARGE_NOISE * random.normal(size=time.size)
    began = clock.process_time()
    found = observe(model, observer, time, voltage, reading, charge)
    took = clock.process_time() - began
    off = np.flatnonzero(np.abs(found.displacement - clean) >= 0.01 * np.ptp(true.displacement))
    late = time >= SETTLED
    errors = (
        (found.displacement - clean) / found.displacement_std,
        (found.polarization - true.polarization) / found.polarization_std,
        (found.phase_fraction - true.phase_fraction) / found.phase_fraction_std,
    )
    y, p, x = (float(np.mean(np.abs(e) <= BAND)) for e in errors)
    return Trial(
        settled_after=float(time[off[-1]]) if off.size else 0.0,
        largest=float(np.max(np.abs(found.displacement - clean)[late])),
        rms=rms(found.displacement[late] - clean[late]),
        inside=(y, p, x),
        polarization_rms=rms(found.polarization[late] - true.polarization[late]),
        early_polarization_rms=rms((found.polarization - true.polarization)[time < EARLY]),
        sample_time=took / time.size,
    )


def observe(
    model: Chain, observer: HysteresisObserver, time: Array, voltage: Array, reading: Array, charge: Array = ABSENT
) -> Estimate:
    """All blocks of a run, joined."""
    state, parts = observer.init(model, Rest(seed=7)), []
    for begin in range(0, time.size, BLOCK):
        block = slice(begin, begin + BLOCK)
        state, estimate = observer.update(model, state, time[block], voltage[block], reading[block], charge[block])
        parts.append(estimate)
    names = Estimate.__dataclass_fields__
    return Estimate(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def measure(quick: bool, tell: Callable[[str], None]) -> list[Table]:
    """A table of figures for each model; 1000 histories with the front model, fewer with slower ones."""
    tables, trials = [], 20 if quick else 1000
    for name, study in MODELS.items():
        count = max(4, round(study.share * trials))
        trial(study.chain, study.observer, 0)  # compiles
        done = []
        for seed in range(count):
            if seed % 10 == 0:
                tell(f"observer, {name}, {seed} of {count}")
            done.append(trial(study.chain, study.observer, 1000 + seed))
        tables.append(_table(name, study.observer.members, done))
    return tables


def _table(name: str, members: float, done: list[Trial]) -> Table:
    sigma = 1e9 * np.hypot(SENSOR.noise_rms, SENSOR.resolution / np.sqrt(12.0))
    inside = [100.0 * float(np.mean([trial.inside[k] for trial in done])) for k in range(3)]
    at_least = Target(95.0, at_least=True)
    figures = [
        Figure("largest error of displacement from 1 s on, worst history",
               100.0 * max(t.largest for t in done) / STROKE, "% of 10 um", Target(1.0)),
        Figure("histories within 1 % of the scan's own stroke from 1 s on",
               100.0 * float(np.mean([t.settled_after < SETTLED for t in done])), "%"),
        Figure("rms error of displacement once settled, worst history", 1e9 * max(t.rms for t in done), "nm",
               Target(sigma / 2)),
        Figure("displacement within its 95 % band", inside[0], "% of samples", at_least),
        Figure("polarization within its 95 % band", inside[1], "% of samples", at_least),
        Figure("phase fraction within its 95 % band", inside[2], "% of samples", at_least),
        Figure("rms error of polarization once settled, all", 1e3 * rms(np.array([t.polarization_rms for t in done])),
               "mC/m^2"),
        Figure(f"... in the first {EARLY:g} s, median",
               1e3 * float(np.median([t.early_polarization_rms for t in done])), "mC/m^2"),
        Figure("time of the observer", 1e6 * float(np.median([t.sample_time for t in done])), "us a sample"),
    ]  # fmt: skip
    note = (
        f"{len(done)} random histories, offset up to ±5 um, drift of 10 nm/s (std), scans at 5 Hz of 60 to 110 V,"
        f" sensor sigma {number(sigma)} nm; {members:.0f} histories in the observer, none of which is one of those."
        " Simulated."
    )
    return figures_table(f"Observer from unknown histories: {name}", figures, note)


def page(origin: str, tables: list[Table]) -> str:
    """The page."""
    text = f"""# Observer

{origin}

The hysteresis observer sees applied voltage and displacement of a stage, and is told neither its history nor its offset
nor its drift. Everything is simulated: its model is the stage's own, the sensor has a least step of 0.1 um and 30 nm of
noise at 20 kHz. Bands are 1.96 of the standard deviations that the observer gives for each sample.

The error is judged against the 10 um of the tracking benchmark. The share of histories that also keep within 1 % of
their own scan is given beside it: where a scan moves the stage by less than 2 um, 1 % of it is four standard deviations
of the settled estimate or less, and single samples go beyond by chance. Histories are followed side by side, so the
time is theirs together; with one member (a history that is known) it is a small part of it.

"With charge" the observer is also given the charge on the ceramic, with 0.1 uC of noise and a zero that it does not
know (`charge_noise_rms`; on the bench the Sawyer-Tower capacitor of the amplifier measures it).

"""
    return text + "\n".join(table.markdown() for table in tables)


def main() -> None:
    """Run the study; write `observer.md` into a folder."""
    from rich.console import Console

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder for the page")
    parser.add_argument("--quick", action="store_true", help="few histories")
    given = parser.parse_args()
    origin = provenance("python -m pzt_benchmarks.unknown_histories" + " --quick" * given.quick)
    with Console(stderr=True).status("observer") as status, one_core():
        tables = measure(given.quick, status.update)
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "observer.md").write_text(page(origin.line(), tables), encoding="utf-8")


if __name__ == "__main__":
    main()
