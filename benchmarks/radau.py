"""The 16 x 16 quadrature against SciPy's Radau, at equal error.

The drive is three legs at 10 MV/m/s; both may choose their own steps within a leg, and Radau starts anew at each turn,
as it should. Error: the largest deviation of x+ from a solution with a step a hundred times finer (exponential
collocation at accuracy 1e-12), each method at its own points: Radau where its steps end, so that its interpolation
does not count. That fine solution is checked against Radau at its own tightest tolerance. Equal error means: of all
settings of ours whose error is not above that of a Radau run, the quickest.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from scipy import integrate, sparse, special

from pzt_benchmarks.drives import ramps, turning_times
from pzt_benchmarks.stopwatch import best, timed
from pzt_benchmarks.table import Figure, Table, Target
from pzt_ros.physics.kinetics import switching_rate
from pzt_ros.physics.quadrature import Quadrature
from pzt_ros.physics.signals import Array, Rest

LEGS = (0.0, 2.0, -1.0, 1.0)
QUICK_LEGS = LEGS[:2]
RATE = 1e7
"""[V/m/s]"""

POINTS = 20
"""At which we look, per leg; our methods take many steps between two of them."""

ACCURACIES = tuple(10.0 ** (-k / 2) for k in range(4, 21))
METHODS = ("midpoint", "collocation")

Rates = Callable[[float], tuple[Array, Array]]


@dataclass(frozen=True)
class Run:
    """One integration: how long it took [s], and its largest error in x+ [-]."""

    name: str
    seconds: float
    error: float


def fine_fraction(legs: tuple[float, ...], at: Array) -> Array:
    """x+ at the times `at` [s], from a far finer solution."""
    model = Quadrature(accuracy=1e-12)
    return model.step(model.init(Rest()), ramps(legs, RATE, at))[1].phase_fraction


def scipy_rates(model: Quadrature) -> Rates:
    """Both switching rates of all domains at a field [V/m], as one writes them with SciPy (3.9, 3.10)."""
    coercive, interaction = _domains(model)
    width, attempt_rate = model.thermal_width, 1.0 / model.relaxation_time

    def rates(field: float) -> tuple[Array, Array]:
        up = (field + interaction - coercive) / width
        down = (-field - interaction - coercive) / width
        # below -26 erfcx overflows, and nothing switches
        return tuple(attempt_rate / special.erfcx(np.maximum(z, -26.0)) for z in (up, down))  # type: ignore[return-value]

    return rates


def compiled_rates(model: Quadrature) -> Rates:
    """The same, compiled: what is left of the difference is the method's."""
    coercive, interaction = _domains(model)
    width, attempt_rate = model.thermal_width, 1.0 / model.relaxation_time
    _fill(0.0, coercive, interaction, width, attempt_rate)
    return lambda field: _fill(field, coercive, interaction, width, attempt_rate)


@njit(cache=True, error_model="numpy", fastmath=True)
def _fill(field, coercive, interaction, width, attempt_rate):  # type: ignore[no-untyped-def]
    up, down = np.empty(coercive.size), np.empty(coercive.size)
    for k in range(coercive.size):
        up[k] = attempt_rate * switching_rate((field + interaction[k] - coercive[k]) / width)
        down[k] = attempt_rate * switching_rate((-field - interaction[k] - coercive[k]) / width)
    return up, down


def _domains(model: Quadrature) -> tuple[Array, Array]:
    """Coercive and interaction field of every domain [V/m]."""
    (coercive, _), (interaction, _) = model.nodes()
    return np.repeat(coercive, interaction.size), np.tile(interaction, coercive.size)


def radau(model: Quadrature, rates: Rates, legs: tuple[float, ...], rtol: float, atol: float, jacobian: bool) -> Array:
    """Integrate all legs; x+ behind each step of Radau's, and when [shape (2, steps)].

    With `jacobian` Radau is given the sparse (diagonal) matrix, otherwise it finds a dense one by differences.
    """
    (_, coercive_weight), (interaction, interaction_weight) = model.nodes()
    weight = np.outer(coercive_weight, interaction_weight).ravel()
    x = np.tile(np.where(interaction < 0, 0.0, 1.0), coercive_weight.size)
    turns, fields, found = turning_times(legs, RATE), np.array(legs) * 1e6, []
    for k in range(len(legs) - 1):
        slope = (fields[k + 1] - fields[k]) / (turns[k + 1] - turns[k])

        def rates_at(t: float, k: int = k, slope: float = slope) -> tuple[Array, Array]:
            return rates(float(fields[k] + slope * (t - turns[k])))

        def change(t: float, x: Array, rates_at: Rates = rates_at) -> Array:
            up, down = rates_at(t)
            return up * (1.0 - x) - down * x

        def matrix(t: float, x: Array, rates_at: Rates = rates_at) -> sparse.csc_matrix:
            up, down = rates_at(t)
            return sparse.diags(-(up + down)).tocsc()

        options = {"jac": matrix} if jacobian else {}
        out = integrate.solve_ivp(change, turns[k : k + 2], x, "Radau", rtol=rtol, atol=atol, **options)
        x = out.y[:, -1]
        found.append(np.stack((out.t, weight @ out.y))[:, 1:])
    return np.concatenate(found, axis=1)


def our_runs(legs: tuple[float, ...], method: str) -> list[Run]:
    """One method of ours at many accuracies."""
    turns = turning_times(legs, RATE)
    at = np.concatenate([np.linspace(a, b, POINTS + 1)[1:] for a, b in pairwise(turns)])
    signals, exact = ramps(legs, RATE, at), fine_fraction(legs, at)
    runs = []
    for accuracy in ACCURACIES:
        model = Quadrature(method=method, accuracy=accuracy)
        start = model.init(Rest())
        seconds = best(functools.partial(model.step, start, signals), 5)
        error = np.max(np.abs(model.step(start, signals)[1].phase_fraction - exact))
        runs.append(Run(method, seconds, float(error)))
    return runs


def quickest(runs: list[Run], error: float) -> Run | None:
    """The quickest run whose error is not above `error`."""
    good = [run for run in runs if run.error <= error]
    return min(good, key=lambda run: run.seconds) if good else None


@dataclass(frozen=True)
class Case:
    """One way to call Radau, and what it is held to."""

    name: str
    jacobian: bool
    rates: Callable[[Quadrature], Rates]
    tolerances: tuple[float, ...]
    target: Target | None = None


CASES = (
    Case("default call", False, scipy_rates, (1e-3, 1e-4), Target(800, True)),
    Case("sparse analytic Jacobian", True, scipy_rates, (1e-3, 1e-4, 1e-6), Target(40, True)),
    Case("sparse analytic Jacobian, our compiled rates", True, compiled_rates, (1e-3, 1e-4, 1e-6)),
)


def radau_run(case: Case, legs: tuple[float, ...], rtol: float) -> Run:
    """One call of Radau with its time and its error."""
    model = Quadrature()
    rates = case.rates(model)
    seconds, (at, fraction) = timed(lambda: radau(model, rates, legs, rtol, 1e-2 * rtol, case.jacobian))
    return Run(f"{case.name}, rtol {rtol:g}", seconds, float(np.max(np.abs(fraction - fine_fraction(legs, at)))))


def ratios(theirs: Run, ours: dict[str, list[Run]]) -> tuple[float, list[str]]:
    """How many times as fast the better of our methods is at equal error, and the cells of all of them."""
    best_ratio, cells = 0.0, []
    for runs in ours.values():
        match = quickest(runs, theirs.error)
        ratio = theirs.seconds / match.seconds if match else 0.0
        best_ratio = max(best_ratio, ratio)
        cells += [f"{1e3 * match.seconds:.2f}", f"{ratio:,.0f}"] if match else ["-", "-"]
    return best_ratio, cells


def measure(quick: bool, tell: Callable[[str], None]) -> tuple[list[Figure], Table]:
    """Radau with a dense and a sparse Jacobian beside ours: the least of the ratios, and all of them."""
    legs = QUICK_LEGS if quick else LEGS
    tell("the quadrature at many accuracies")
    ours = {method: our_runs(legs, method) for method in METHODS}
    figures, rows = [], []
    for case in CASES:
        found = []
        for rtol in case.tolerances[:1] if quick and not case.jacobian else case.tolerances:
            tell(f"Radau, {case.name}, rtol {rtol:g}")
            theirs = radau_run(case, legs, rtol)
            ratio, cells = ratios(theirs, ours)
            found.append(ratio)
            rows.append((theirs.name, f"{1e3 * theirs.seconds:,.0f}", f"{theirs.error:.1e}", *cells))
        figures.append(Figure(f"quadrature 16 x 16 against Radau, {case.name}", min(found), "x as fast", case.target))
    heads = ("Radau", "ms", "error in x+", "midpoint ms", "ratio", "collocation ms", "ratio")
    return figures, Table("Quadrature 16 x 16 against SciPy's Radau at equal error", heads, rows, _note(legs, quick))


def _note(legs: tuple[float, ...], quick: bool) -> str:
    model = Quadrature()
    at, fraction = radau(model, compiled_rates(model), legs, 1e-7 if quick else 1e-9, 1e-12, True)
    check = np.max(np.abs(fraction - fine_fraction(legs, at)))
    return (
        f"{turning_times(legs, RATE)[-1]:.1f} s of ramps at 10 MV/m/s. The default call finds a dense Jacobian by"
        " differences. `atol` is `rtol`/100. Ours is the quickest setting whose error is not above that of the Radau"
        " run in the same row. Error is the largest deviation of x+ from a far finer solution (collocation at accuracy"
        f" 1e-12), each method at the ends of its own steps or, ours, at {POINTS} points per leg; Radau at its"
        f" tightest agrees with that solution to {check:.0e}. Among the targets stands the least ratio of a kind, with"
        " the better of our methods."
    )
