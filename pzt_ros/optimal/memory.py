"""What a ceramic remembers, as the barrier laws of the branches that a horizon runs along (thesis 3.23, 3.34, 3.35).

Reversal points that lie within the horizon depend on the solution, so all of this is written for numbers and for
CasADi's expressions alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from pzt_ros.errors import BenchError
from pzt_ros.optimal.inverse_erfc import place
from pzt_ros.optimal.law import Material
from pzt_ros.optimal.problem import UP, Problem
from pzt_ros.physics import parametrized_branch as full
from pzt_ros.physics import parametrized_single_branch as single
from pzt_ros.physics.link import State
from pzt_ros.physics.one_equation import OneEquation
from pzt_ros.physics.parametrized import Parametrized
from pzt_ros.physics.parametrized_single import ParametrizedSingle
from pzt_ros.physics.signals import Rest

Law = tuple[Any, ...]
"""Centre, slope, gain and offset of the barrier upwards, and downwards; numbers or expressions."""

_NEVER = 1e11
"""A barrier that no field crosses [V/m]."""


@dataclass(frozen=True)
class Mathematics:
    """The two functions that numbers and expressions need from different libraries."""

    erf: Any
    place: Any
    """w with erfc(-w) = y."""


NUMBERS = Mathematics(math.erf, place)


def material_of(problem: Problem) -> Material:
    """The numbers of the problem's ceramic that stay the same from branch to branch."""
    return numbers_of(problem.ceramic)


def numbers_of(ceramic: OneEquation) -> Material:
    """The numbers of a ceramic that stay the same from branch to branch."""
    m = ceramic.material
    return Material(m.thermal_width, m.relaxation_time, m.domain_polarization, m.reciprocal_permittivity)


def remembers(ceramic: OneEquation) -> bool:
    """Whether its barrier depends on where the branch began."""
    return isinstance(ceramic, Parametrized) or (
        isinstance(ceramic, ParametrizedSingle) and ceramic.distribution == "coercive"
    )


def has_history(problem: Problem) -> bool:
    """Whether the problem's ceramic has a memory."""
    return remembers(problem.ceramic)


def fraction_of(ceramic: OneEquation, state: State) -> float:
    """x+ in a state."""
    return float(state[full.X if isinstance(ceramic, Parametrized) else single.X])


def initial_fraction(problem: Problem) -> float:
    """x+ at the beginning: as given, or the ceramic's at rest.

    Raises:
        BenchError: it is given for a ceramic with history, whose state is more than x+.
    """
    if not math.isnan(problem.initial_phase_fraction):
        if has_history(problem):
            raise BenchError(
                f"{problem.name}: initial_phase_fraction does not say what a ceramic with history remembers; leave it"
                " out and set the ceramic's start"
            )
        return float(problem.initial_phase_fraction)
    return fraction_of(problem.ceramic, problem.ceramic.init(Rest()))


def changes_of_branch(ceramic: OneEquation, state: State) -> float:
    """How often the branch has changed: a number that stays while the law does."""
    if isinstance(ceramic, Parametrized):
        return float(state[full.REVERSALS] + state[full.CLOSURES])
    return float(state[single.CHANGES])


def law_without_history(ceramic: ParametrizedSingle) -> Law:
    """The one law of a ceramic that remembers nothing: E_c(x+) and -E_c(1 - x+), or E_c and -E_c minus E_e(x+)."""
    m = ceramic.material
    mass = 2.0 - m.below
    up = (m.centre, m.slope, mass, m.below)
    if ceramic.distribution == "interaction":
        return (*up, -m.centre, m.slope, mass, m.below)
    return (*up, -m.centre, -m.slope, -mass, 2.0)


@dataclass(frozen=True)
class Run:
    """The laws along a way in one direction, from the innermost loop outwards.

    Attributes:
        rising: whether x+ grows.
        laws: of the branches, one more than there are limits.
        limits: x+ where a loop is closed and the next law begins.
    """

    rising: bool
    laws: tuple[Law, ...]
    limits: tuple[Any, ...] = ()


class Memory:
    """The stack of reversal points of a ceramic, and the branch that it is on.

    Args:
        ceramic: parametrized.
        state: of it.
        mathematics: of what later reversal points will be made.
    """

    def __init__(self, ceramic: OneEquation, state: State, mathematics: Mathematics = NUMBERS) -> None:
        self._ceramic: Any = ceramic
        self._math = mathematics
        self._points: list[tuple[Any, Any]] = []
        if isinstance(ceramic, Parametrized):
            rows = state[full.STACK : full.STACK + 3 * int(state[full.COUNT])].reshape(-1, 3)
            self._points = [(float(x), float(barrier)) for x, _, barrier in rows]
        elif remembers(ceramic):
            points = state[single.STACK : single.STACK + int(state[single.COUNT])]
            self._points = [(float(x), 0.0) for x in points]

    def runs(self, problem: Problem, fractions: Any, expected: Any) -> list[Run]:
        """What every interval of a problem follows [N of them].

        Args:
            problem: with its segments.
            fractions: gives x+ at the beginning of an interval by its number; numbers or expressions.
            expected: the same as numbers, roughly: it says which loops are closed before a branch turns.

        Raises:
            BenchError: there is a memory, and the problem does not say which segments to follow.
        """
        if not remembers(self._ceramic):
            return [Run(True, (self.law(),))] * problem.steps
        if problem.segments is None:
            raise BenchError(
                f"{problem.name}: the ceramic has history, so this solver needs the sequence of branches; give"
                " 'segments:', or solve it by simulation"
            )
        found: list[Run] = []
        begin = 0
        for segment in problem.segments:
            end = round(segment.until / problem.step)
            if end <= begin:
                raise BenchError(
                    f"{problem.name}: the segment until {segment.until:g} s is shorter than an interval of"
                    f" {problem.step:g} s; use more intervals"
                )
            if (segment.direction == UP) != self._rising:
                self._reverse(fractions(begin))
            found += [self._run()] * (end - begin)
            self._close(expected(end))
            begin = end
        return found

    def law(self) -> Law:
        """Of the present branch."""
        if isinstance(self._ceramic, Parametrized):
            law = self._branch()
            return (*law, *law)
        if not remembers(self._ceramic):
            return law_without_history(self._ceramic)
        m = self._ceramic.material
        mass = 2.0 - m.below
        base = self._points[-1][0]
        never = (0.0, 0.0, 1.0)
        if self._rising:
            return (m.centre, m.slope, mass, m.below - mass * base, -_NEVER, *never)
        return (_NEVER, *never, -m.centre, -m.slope, -mass, m.below + mass * base)

    @property
    def _rising(self) -> bool:
        return len(self._points) % 2 == 0

    def _run(self) -> Run:
        kept = list(self._points)
        laws, limits = [self.law()], []
        while len(self._points) >= 4:
            limits.append(self._points[-2][0])
            del self._points[-2:]
            laws.append(self.law())
        self._points = kept
        return Run(self._rising, tuple(laws), tuple(limits))

    def _close(self, x: float) -> None:
        """Forget the loops that are closed on the way to x+; those that end at expressions are taken as open."""
        while len(self._points) >= 4:
            limit = self._points[-2][0]
            if not isinstance(limit, float) or (x < limit if self._rising else x > limit):
                return
            del self._points[-2:]

    def _branch(self) -> tuple[Any, Any, Any, Any]:
        """Centre, slope, gain and offset between the two topmost points."""
        m = self._ceramic.material
        if self._rising:
            centre, slope = m.barrier_ascending, m.barrier_ascending * m.shape_ascending
        else:
            centre, slope = -m.barrier_descending, m.barrier_descending * m.shape_descending
        (x, b), (other_x, other_b) = self._points[-1], self._points[-2]
        here, there = (1.0 + self._math.erf((barrier - centre) / slope) for barrier in (b, other_b))
        gain = (there - here) / (other_x - x)
        return centre, slope, gain, here - gain * x

    def _reverse(self, x: Any) -> None:
        barrier = 0.0
        if isinstance(self._ceramic, Parametrized):
            centre, slope, gain, offset = self._branch()
            barrier = centre + slope * self._math.place(gain * x + offset)
        self._points.append((x, barrier))
