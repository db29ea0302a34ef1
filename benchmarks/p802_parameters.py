"""`python -m pzt_benchmarks.p802_parameters`: the thesis' actuator, fitted to what chapter 2 says in numbers.

The thesis prints no curves, only a dozen numbers; this finds the lattice and the strain law that meet them together
and prints a table criterion / model. The result stands in `msgs_config/chains/p802.yaml`. `--from-scratch` searches the
whole box first (five minutes), otherwise the search starts from the shipped chain (ten seconds).
"""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution, least_squares

from pzt_ros.chains import load_chain
from pzt_ros.experiments.procedures import Procedure, procedure
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import ACTUATOR
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.physics.structure import Structure

Array = NDArray[np.float64]
PER_LEG = 200

FREE = {
    "coercive_field": (2e5, 1.2e6),
    "coercive_field_spread": (3e10, 3e12),
    "interaction_field_spread": (3e9, 2e12),
    "relaxation_time": (3e-5, 2.0),
    "domain_polarization": (0.17, 0.30),
    "reciprocal_permittivity": (1e7, 1e8),
    "domain_volume": (1e-23, 2e-21),
    "coefficient": (0.016, 0.026),
    "polarization_lead": (1e-3, 0.05),
}
"""Parameters that move, by name, with their bounds; they are searched on a logarithmic scale."""


@dataclass(frozen=True)
class Run:
    """One experiment on the bare actuator; `ends` are the samples at which its phases end."""

    time: Array
    voltage: Array
    polarization: Array
    strain: Array
    ends: list[int]

    def leg(self, phase: int) -> slice:
        """The samples of one phase, with the last of the phase before."""
        return slice(self.ends[phase - 1], self.ends[phase] + 1)

    def end(self, quantity: str, phase: int) -> float:
        """The value of a quantity at the end of a phase."""
        return float(getattr(self, quantity)[self.ends[phase]])


def run(chain: Chain, experiment: Procedure) -> Run:
    """The experiment up to the end of its second hold; legs evenly sampled, holds the denser the earlier."""
    time, voltage, ends = [np.zeros(1)], [np.zeros(1)], []
    for phase in experiment.phases()[:-1]:
        hold = phase.to == voltage[-1][-1]
        parts = np.geomspace(1e-4, 1.0, 60) if hold else np.arange(1, PER_LEG + 1) / PER_LEG
        voltage.append(phase.value(float(voltage[-1][-1]), phase.length * parts))
        time.append(time[-1][-1] + phase.length * parts)
        ends.append(sum(len(part) for part in time) - 1)
    t, v = np.concatenate(time), np.concatenate(voltage)
    _, out = chain.step(chain.init(Rest()), Signals(t, v))
    length = next(link.active_length for link in chain.links if hasattr(link, "active_length"))
    return Run(t, v, out.polarization, out.displacement / length, ends)


def observe(chain: Chain) -> dict[str, float]:
    """The numbers of chapter 2, as this chain gives them; SI."""
    area = next(link.electrode_area for link in chain.links if hasattr(link, "electrode_area"))
    slow = run(chain, procedure("type1", "0.1 Hz", reversal="-40 V"))
    fast = run(chain, procedure("type1", "100 Hz", reversal="-40 V"))
    full = run(chain, procedure("full-loop", "0.1 Hz"))
    full_fast = run(chain, procedure("full-loop", "1 Hz"))
    relaxed = [run(chain, procedure("relaxation", rate, reversal="-20 V")) for rate in ("0.1 Hz", "100 Hz")]
    up = slow.leg(3)
    steepest = np.argmax(np.gradient(slow.polarization[up], slow.voltage[up])[1:-1]) + 1
    legs = slice(full.ends[1], full.ends[3] + 1)
    current = area * np.diff(full.polarization[legs]) / np.diff(full.time[legs])
    hold = relaxed[0].leg(3)
    after_second = np.interp(relaxed[0].time[hold][0] + 1.0, relaxed[0].time[hold], relaxed[0].strain[hold])
    return {
        "strain at 150 V": slow.end("strain", 1),
        "polarization at -40 V, 0.1 Hz": slow.end("polarization", 2),
        "polarization at -40 V, 100 Hz": fast.end("polarization", 2),
        "strain at -40 V, 0.1 Hz": slow.end("strain", 2),
        "strain at -40 V, 100 Hz": fast.end("strain", 2),
        "voltage of fastest switching upwards": float(slow.voltage[up][steepest]),
        "peak current, full loop 0.1 Hz": float(np.max(np.abs(current))),
        "coercive voltage, full loop 0.1 Hz": coercive_voltage(full),
        "coercive voltage, full loop 1 Hz": coercive_voltage(full_fast),
        "strain before the hold at -20 V, 0.1 Hz": relaxed[0].end("strain", 2),
        "strain before the hold at -20 V, 100 Hz": relaxed[1].end("strain", 2),
        "strain after 1 s at -20 V, 0.1 Hz": float(after_second),
        "strain after 10 s at -20 V, 0.1 Hz": relaxed[0].end("strain", 3),
        "strain after 10 s at -20 V, 100 Hz": relaxed[1].end("strain", 3),
    }


def coercive_voltage(full: Run) -> float:
    """Where the polarization crosses 0 on the way down [V]."""
    down = full.leg(2)
    return float(np.interp(0.0, -full.polarization[down], full.voltage[down]))


TARGETS: dict[str, tuple[float, float]] = {
    "strain at 150 V": (13.3e-6 / 8e-3, 0.01),
    "polarization at -40 V, 0.1 Hz": (0.12, 0.04),
    "polarization at -40 V, 100 Hz": (0.16, 0.04),
    "strain at -40 V, 0.1 Hz": (0.02e-2, 0.03),
    "strain at -40 V, 100 Hz": (0.035e-2, 0.03),
    "voltage of fastest switching upwards": (40.0, 0.2),
    "peak current, full loop 0.1 Hz": (0.6e-3, 0.3),
}
"""What the thesis says (2.1.2, 2.2.2, 2.2.3), and the relative error that weighs as one."""


def misses(chain: Chain) -> Array:
    """Errors over their weights, and two conditions on the relaxation [-]."""
    seen = observe(chain)
    errors = [(seen[name] / target - 1.0) / weight for name, (target, weight) in TARGETS.items()]
    one_level = seen["strain after 10 s at -20 V, 100 Hz"] - seen["strain after 10 s at -20 V, 0.1 Hz"]
    moving = seen["strain after 1 s at -20 V, 0.1 Hz"] - seen["strain after 10 s at -20 V, 0.1 Hz"]
    return np.array([*errors, one_level / 1e-5, min(moving / 1e-5 - 1.0, 0.0)])


def with_values(chain: Chain, logarithms: Array) -> Chain:
    """The chain with the free parameters set, given as decimal logarithms."""
    values = dict(zip(FREE, 10.0**logarithms, strict=True))

    def change(link):  # type: ignore[no-untyped-def]
        return dataclasses.replace(link, **{name: v for name, v in values.items() if hasattr(link, name)})

    return chain.with_links(change)


def bare_actuator(chain: Chain) -> Chain:
    """Ceramic and strain, without a mode that a few samples per leg cannot show."""
    part = chain.section(ACTUATOR)
    return dataclasses.replace(part, links=tuple(link for link in part.links if not isinstance(link, Structure)))


def main(from_scratch: bool) -> None:
    """Search, and print the parameters and the table."""
    chain = bare_actuator(load_chain("p802"))
    low, high = (np.log10([bound[k] for bound in FREE.values()]) for k in (0, 1))
    start = np.log10([next(getattr(link, name) for link in chain.links if hasattr(link, name)) for name in FREE])
    if from_scratch:
        found = differential_evolution(
            lambda x: float(np.sum(misses(with_values(chain, x)) ** 2)),
            list(zip(low, high, strict=True)),
            popsize=10,
            maxiter=18,
            seed=1,
            polish=False,
            init="sobol",
        )
        start = found.x
    refined = least_squares(
        lambda x: misses(with_values(chain, x)), start, bounds=(low, high), diff_step=1e-3, x_scale=0.1, max_nfev=30
    )
    for name, logarithm in zip(FREE, refined.x, strict=True):
        print(f"{name}: {10.0**logarithm:.4g}")
    for name, value in observe(with_values(chain, refined.x)).items():
        target = f"{TARGETS[name][0]:.4g}" if name in TARGETS else ""
        print(f"{name:45s} {target:>10s} {value:10.4g}")


if __name__ == "__main__":
    main("--from-scratch" in sys.argv)
