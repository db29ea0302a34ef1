"""How long the models take for a sample, forwards and backwards, and how much faster than real time that is at 20 kHz.

The drive is the record of twenty nested legs at 10 MV/m/s, in blocks of 100 samples as between nodes, or in one piece.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import numpy as np

from pzt_benchmarks.drives import SAMPLE_RATE, blocks, multisine, sampled_ramps
from pzt_benchmarks.stopwatch import best, timed
from pzt_benchmarks.table import Figure, Table, Target, number
from pzt_ros.chains import load_chain
from pzt_ros.physics.front import Front
from pzt_ros.physics.front_sets import step_all
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.link import Link
from pzt_ros.physics.parametrized import Parametrized
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.physics.polycrystal_kernel import HEAD
from pzt_ros.physics.quadrature import Quadrature
from pzt_ros.physics.signals import Rest, Signals

RATE = 1e7
"""[V/m/s]; at it the midpoint rule takes one step a sample for an accuracy of 1e-6 in x+."""

BLOCK = 100
SETS, SET_SAMPLES = 1000, 20_000
KINETICS = ("relaxation_time", "reciprocal_permittivity", "domain_polarization")
DENSITIES = ("coercive_field", "coercive_field_spread", "interaction_field_spread")
HEADS = ("model", "domains", "samples at once", "ns a sample", "ns a domain", "x real time")


@dataclasses.dataclass(frozen=True)
class Speed:
    """What a sample costs [s] in one model; `domains` 0 where it has none."""

    name: str
    domains: int
    at_once: int
    seconds: float

    @property
    def real_time(self) -> float:
        """Simulated time over processor time at 20 kHz [-]."""
        return 1.0 / (SAMPLE_RATE * self.seconds)

    def row(self) -> tuple[str, ...]:
        """One row of the table."""
        domains, each = ("", "")
        if self.domains:
            domains, each = f"{self.domains:,}", f"{1e9 * self.seconds / self.domains:.2f}"
        return (
            self.name, domains, f"{self.at_once:,}", number(1e9 * self.seconds), each, number(self.real_time)
        )  # fmt: skip


def speed(name: str, link: Link, signals: Signals, at_once: int, repeats: int = 5, inverse: bool = False) -> Speed:
    """Time a link over a record; its inverse over the polarization that the link itself gives."""
    start = link.init(Rest())
    if inverse:
        signals = link.step(start, signals)[1]
    call = link.invert if inverse else link.step
    pieces = list(blocks(signals, at_once))

    def record() -> None:
        state = start
        for piece in pieces:
            state, _ = call(state, piece)

    domains = start.size - HEAD if isinstance(link, Polycrystal) else 0
    return Speed(name, domains, at_once, best(record, repeats) / signals.time.size)


def lattice_of(domains: int) -> Lattice:
    """The coarsest lattice with at least so many domains, for real time."""
    spacing = 0.5
    while True:
        lattice = Lattice(spacing=spacing, method="midpoint")
        coercive, interaction = lattice.nodes()
        if coercive[0].size * interaction[0].size >= domains:
            return lattice
        spacing *= 0.998


def midpoint_error() -> float:
    """Largest error in x+ of the midpoint rule on the record, against collocation with a far finer step [-]."""
    signals = sampled_ramps(RATE)
    fractions = []
    for method, accuracy in (("midpoint", 1e-6), ("collocation", 1e-10)):
        model = Quadrature(method=method, accuracy=accuracy)
        fractions.append(model.step(model.init(Rest()), signals)[1].phase_fraction)
    return float(np.max(np.abs(fractions[0] - fractions[1])))


def front_sets(count: int, shared: bool) -> Callable[[], None]:
    """A run over 20,000 samples for each of `count` parameter sets, which share their densities or do not."""
    rng = np.random.default_rng(0)
    signals = sampled_ramps(36.0e6, samples=SET_SAMPLES)
    names = KINETICS if shared else (*KINETICS, *DENSITIES)
    usual = Front()
    models = [
        Front(**{name: getattr(usual, name) * factor for name, factor in zip(names, factors, strict=True)})
        for factors in rng.uniform(0.8, 1.2, (count, len(names)))
    ]

    def run() -> None:
        for _ in step_all(models, Rest(), signals):
            pass

    return run


def parametrized() -> Parametrized:
    """The thesis' set P3."""
    return next(link for link in load_chain("thesis-p3").links if isinstance(link, Parametrized))


def measure(quick: bool, tell: Callable[[str], None]) -> tuple[list[Figure], Table]:
    """The figures that have targets, and a table of all speeds."""
    record = sampled_ramps(RATE, samples=10_000 if quick else None)
    part = sampled_ramps(RATE, samples=1000 if quick else 10_000)
    whole = record.time.size
    fast, accurate, front, ode = Quadrature(method="midpoint"), Quadrature(), Front(), parametrized()
    large, larger = lattice_of(66_800), lattice_of(100_000)
    jobs: dict[str, Callable[..., Speed]] = {
        "quadrature 16 x 16, midpoint": functools.partial(speed, link=fast, signals=part, at_once=BLOCK),
        "quadrature 16 x 16, collocation": functools.partial(speed, link=accurate, signals=part, at_once=BLOCK),
        "... its inverse": functools.partial(speed, link=accurate, signals=part, at_once=BLOCK, inverse=True),
        "lattice of 66,800": functools.partial(speed, link=large, signals=part, at_once=BLOCK, repeats=3),
        "lattice of 100,000": functools.partial(speed, link=larger, signals=part, at_once=BLOCK, repeats=3),
        "parametrized": functools.partial(speed, link=ode, signals=record, at_once=whole),
        "parametrized in blocks": functools.partial(speed, link=ode, signals=record, at_once=BLOCK),
        "parametrized, inverse": functools.partial(speed, link=ode, signals=record, at_once=BLOCK, inverse=True),
        "front": functools.partial(speed, link=front, signals=record, at_once=whole),
        "front in blocks": functools.partial(speed, link=front, signals=record, at_once=BLOCK),
        "front, inverse": functools.partial(speed, link=front, signals=record, at_once=BLOCK, inverse=True),
        "front, 200 Hz multisine": functools.partial(speed, link=front, signals=multisine(200.0, whole), at_once=whole),
    }
    found = {}
    for name, job in jobs.items():
        tell(name)
        found[name] = job(name)
    count = 50 if quick else SETS
    tell(f"{count} parameter sets of the front model")
    every, shared = (SETS / count * timed(front_sets(count, together))[0] for together in (False, True))
    quadrature, lattice, more, fronts = (
        found[name] for name in ("quadrature 16 x 16, midpoint", "lattice of 66,800", "lattice of 100,000", "front")
    )
    sets = f"{SETS:,} parameter sets over {SET_SAMPLES:,} samples"
    figures = [
        Figure("quadrature 16 x 16, midpoint, at 20 kHz", quadrature.real_time, "x real time", Target(10, True)),
        Figure(f"lattice of {lattice.domains:,} domains", lattice.real_time, "x real time", Target(1, True)),
        Figure(f"lattice of {more.domains:,} domains", more.real_time, "x real time", Target(None, True, aim=1)),
        Figure("front model, nested legs", 1e9 * fronts.seconds, "ns a sample", Target(150, aim=50)),
        Figure("front model, nested legs, at 20 kHz", fronts.real_time, "x real time", Target(300, True)),
        Figure(f"front model, {sets}, all parameters vary", every, "s", Target(3)),
        Figure("... the densities are the same", shared, "s"),
    ]
    note = (
        f"Drive: twenty nested legs at 10 MV/m/s, at 20 kHz; the first {part.time.size:,} samples for quadrature and"
        f" lattice, {whole:,} for the others. The midpoint rule's largest error in x+ over it is {midpoint_error():.0e}"
        " (one step a sample). A lattice of 66,800 domains is finer than anyone needs (docs/convergence.md)."
    )
    if count < SETS:
        note += f" Parameter sets: {count} of them, times {SETS // count}."
    return figures, Table("What a sample costs", HEADS, [s.row() for s in found.values()], note)
