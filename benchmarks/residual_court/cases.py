"""The cases that are tried: what is hidden in each, how large, in which runs; and how they are made."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from .effect import Effect
from .effects import INSIDE, OUTSIDE, OWN_PROTOCOL, PLAIN, effect_class
from .generator import Bench, bench
from .scaling import Projection
from .specimens import RIGHT, WRONG

Array = NDArray[np.float64]
Columns = dict[str, Array]

SIZES = (1.0, 1.5, 3.0, 10.0)
"""Rms left by an effect after the base has adapted, in units of the noise."""

ALIKE = (
    frozenset({"sensor_lag", "amplifier_bandwidth", "mechanical_resonance"}),
    frozenset({"slow_relaxation", "thermal_drift"}),
)
"""Effects that one cannot tell from another where they last equally long (diagnosis-methods.md 3.4)."""


@dataclass(frozen=True)
class Spec:
    """What a case is to be.

    Attributes:
        kind: the table it belongs to.
        family: of the truth.
        effects: hidden, by name.
        size: of each, in units of the noise.
        protocol, reading: by name.
        seed: everything random comes from it.
        declared: whether the diagnosis is told a chain with the right links and wrong numbers.
        shape: parameters of the effects that are not drawn but given.
    """

    kind: str
    family: str
    effects: tuple[str, ...] = ()
    size: float = 0.0
    protocol: str = "standard"
    reading: str = "white"
    seed: int = 0
    declared: bool = True
    shape: tuple[tuple[str, float], ...] = ()

    @property
    def name(self) -> str:
        """For folders and tables."""
        what = "+".join(self.effects) or "null"
        size = f"-{self.size:g}x" if self.effects else ""
        chain = "" if self.declared else "-undeclared"
        return f"{self.kind}-{self.family}-{what}{size}-{self.protocol}-{self.reading}{chain}-{self.seed}"


@dataclass(frozen=True)
class Case:
    """A case as it is tried.

    Attributes:
        spec: what was asked for.
        bench: the specimen, from which further runs can be had.
        effects: with true parameters.
        sizes: reached by each.
        train, test, score: runs, each with columns as in contract.md.
    """

    spec: Spec
    bench: Bench
    effects: tuple[Effect, ...]
    sizes: tuple[float, ...]
    train: tuple[Columns, ...]
    test: tuple[Columns, ...]
    score: tuple[Columns, ...]

    def truth(self) -> dict[str, object]:
        """What is true, for a file that the diagnosis does not read."""
        return {
            "name": self.spec.name,
            "family": self.spec.family,
            "specimen": {key: float(value) for key, value in self.bench.truth.parameters.items()},
            "effects": [
                {"name": each.name, "size": size, "amplitude": float(each.amplitude), "parameters": each.parameters()}
                for each, size in zip(self.effects, self.sizes, strict=True)
            ],
        }


def make_case(spec: Spec) -> Case:
    """Draw specimen and effects, scale each effect by itself, and make the runs."""
    made = bench(spec.family, spec.protocol, spec.seed)
    effects, sizes = [], []
    if spec.effects:
        projection = Projection.of(made)
        for name in spec.effects:
            rng = np.random.default_rng([spec.seed, zlib.crc32(name.encode()), 11])
            drawn = effect_class(name).drawn(rng)
            drawn = replace(drawn, shape={**drawn.shape, **dict(spec.shape)})
            effect, size = projection.scaled(drawn, spec.size)
            effects.append(effect)
            sizes.append(size)
    records = [made.record(number, effects, spec.reading) for number in range(len(made.runs))]
    after_train, known = len(made.protocol.train), made.protocol.known
    return Case(
        spec, made, tuple(effects), tuple(sizes),
        tuple(records[:after_train]), tuple(records[after_train:known]), tuple(records[known:]),
    )  # fmt: skip


def _nulls_right(count: int, seed: int) -> Iterator[Spec]:
    readings = ("white", "white", "coloured", "quantised", "gaps")
    for number in range(count):
        protocol = ("standard", "slow", "standard", "with_polarization")[number % 4]
        yield Spec("null_right", RIGHT, protocol=protocol, reading=readings[number % 5], seed=seed + number)


def _effects_right(count: int, seed: int) -> Iterator[Spec]:
    for number in range(count):
        for effect in INSIDE:
            for size in SIZES:
                protocol = OWN_PROTOCOL.get(effect, "standard")
                yield Spec("effect_right", RIGHT, (effect,), size, protocol, seed=seed + number)


def _nulls_wrong(count: int, seed: int) -> Iterator[Spec]:
    for number in range(count):
        for place, family in enumerate(WRONG, start=number):
            yield Spec("null_wrong", family, seed=seed + number, declared=place % 2 == 0)


def _effects_wrong(count: int, seed: int) -> Iterator[Spec]:
    for number in range(count):
        for place, (family, effect) in enumerate(product(WRONG, PLAIN), start=number):
            for size in (1.0, 3.0, 10.0):
                yield Spec("effect_wrong", family, (effect,), size, seed=seed + number, declared=place % 2 == 0)


def _pairs(count: int, seed: int) -> Iterator[Spec]:
    pairs = [pair for pair in combinations(PLAIN, 2) if not any(set(pair) <= alike for alike in ALIKE)]
    for number in range(count):
        for pair in pairs:
            yield Spec("pair", RIGHT, pair, 3.0, seed=seed + number)


def _outside(count: int, seed: int) -> Iterator[Spec]:
    for number in range(count):
        for effect in OUTSIDE:
            for size in (3.0, 10.0):
                yield Spec("outside", RIGHT, (effect,), size, seed=seed + number, declared=number % 2 == 0)


def _confounded(count: int, seed: int) -> Iterator[Spec]:
    """Late by one constant at one frequency, and one exponential in one hold: two effects each that look the same."""
    for number in range(count):
        rng = np.random.default_rng([seed + number, 17])
        for effect in ("sensor_lag", "amplifier_bandwidth"):
            one_pole = (("delay_share", 0.0), ("second_pole", 0.0))
            for size in (1.5, 3.0):
                yield Spec("confounded", RIGHT, (effect,), size, "one_sine", seed=seed + number, shape=one_pole)
        constant = float(rng.uniform(4.0, 10.0))
        shapes = {
            "slow_relaxation": (("states", 1.0), ("shortest_time", constant), ("longest_time", constant)),
            "thermal_drift": (("kind", 1.0), ("time_constant", constant), ("steady", 1.0)),
        }
        for effect, shape in shapes.items():
            for size in (3.0, 10.0):
                yield Spec("confounded", RIGHT, (effect,), size, "one_hold", seed=seed + number, shape=shape)


def _unknown_start(count: int, seed: int) -> Iterator[Spec]:
    seen = [effect for effect in PLAIN if effect != "mechanical_resonance"]  # slow drives do not excite it
    for number in range(count):
        yield Spec("unknown_start", RIGHT, protocol="unknown_start", seed=seed + number)
        effect = seen[number % len(seen)]
        yield Spec("unknown_start", RIGHT, (effect,), 3.0, "unknown_start", seed=seed + number)


KINDS = {
    "null_right": (_nulls_right, 1000),
    "effect_right": (_effects_right, 8),
    "null_wrong": (_nulls_wrong, 10),
    "effect_wrong": (_effects_wrong, 1),
    "pair": (_pairs, 2),
    "outside": (_outside, 8),
    "confounded": (_confounded, 10),
    "unknown_start": (_unknown_start, 20),
}
"""Tables of the court, and how many rounds of each the whole court has."""


def cases(kind: str, seed: int, rounds: int | None = None) -> list[Spec]:
    """One table of cases; seeds of two tables never meet."""
    make, whole = KINDS[kind]
    first = 1_000_000 * seed + 100_000 * list(KINDS).index(kind)
    return list(make(whole if rounds is None else rounds, first))
