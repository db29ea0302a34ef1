"""Manual operation: the conductor of a run in which an operator says what happens."""

from __future__ import annotations

import numpy as np

from pzt_ros.chains import load_model
from pzt_ros.controllers.feasible import forecast
from pzt_ros.errors import BenchError
from pzt_ros.experiments.experiment import Experiment
from pzt_ros.experiments.operation import ManualOperation
from pzt_ros.experiments.trajectory import Path, Trajectory, joined
from pzt_ros.physics.signals import REHEARSAL, Array, Rest, Signals
from pzt_ros.reference import DISPLACEMENT, Reference, block_times
from pzt_ros.scenario import Scenario

LOOKED_AT = 4000
"""Whether a trajectory can be followed is seen at about so many samples of it, and around every point."""


class ManualConductor:
    """Holds the stage where it was found, follows trajectories, and poles.

    It begins anew, where the stage is then, whenever the block asked for does not follow the one before: a stage that
    was disabled and enabled again is elsewhere. The model follows the applied voltage, so that what cannot be followed
    is refused before it is tried.
    """

    length = 0.0  # of the run: not known

    def __init__(self, scenario: Scenario, operation: ManualOperation, axis: str) -> None:
        self._scenario = scenario
        self._operation = operation
        self._axis = axis
        self._model = load_model(scenario.model).behind_amplifier
        self._state = self._model.init(Rest(seed=scenario.seed))
        self._applied = (0.0, 0.0)
        self._path = Path.held(0.0, 0.0)
        self._poling: Experiment | None = None
        self._next = -1
        self._to_name = operation.controller
        self._warm_up()

    @property
    def doing(self) -> str:
        """pole, trajectory or hold."""
        if self._poling is not None:
            return "pole"
        return "trajectory" if self.left > 0.0 else "hold"

    @property
    def left(self) -> float:
        """Of the trajectory or the poling [s]."""
        if self._poling is not None:
            return self._poling.left
        return max(0.0, self._path.end - self._now)

    @property
    def _now(self) -> float:
        """Time of the last sample that was given out [s]."""
        return self._before(self._next)

    def observe(self, time: Array, voltage: Array) -> None:
        """A block was applied: its times [s] and voltages [V, each shape (n,)]."""
        self._state, _ = self._model.step(self._state, Signals(time, voltage))
        self._applied = float(time[-1]), float(voltage[-1])

    def step(self, block: int, displacement: float, voltage: float) -> Reference:
        """The reference of block number `block`; displacement [m] and voltage [V] are as found in the block before."""
        if block != self._next:
            self._poling = None
            self._path = Path.held(self._before(block), displacement)
        self._next = block + 1
        reference = self._poling.step(block, displacement, voltage) if self._poling is not None else None
        if reference is None and self._poling is not None:
            self._poling = None
            self._path = Path.held(self._before(block), displacement)
        return reference or self._along_the_path(block)

    # -- what is asked

    def follow(self, trajectory: Trajectory) -> None:
        """Follow a trajectory from now on, in place of the present one.

        Raises:
            BenchError: it is malformed, cannot be followed, or nothing is followed now; the present one stays.
        """
        if self._poling is not None:
            raise BenchError(f"{self._in_words}; wait for its end, or disable")
        path = joined(trajectory, self._axis, self._path, self._now)
        self._refuse_what_cannot_be(path)
        self._path = path

    def pole(self) -> float:
        """Pole the stage from now on; returns how long it takes [s].

        Raises:
            BenchError: something else is going on, or the limits are too narrow for it.
        """
        if self.doing != "hold":
            raise BenchError(f"cannot pole: {self._in_words}; wait for its end")
        highest = self._scenario.limits.voltage_max
        if self._operation.poling_voltage > highest:
            raise BenchError(
                f"cannot pole: that takes {self._operation.poling_voltage:g} V, and limits.voltage_max is {highest:g} V"
            )
        scenario = self._scenario
        self._poling = Experiment(self._operation.poling(), scenario.sample_rate, scenario.block_size)
        return self._poling.length

    # -- inside

    def _before(self, block: int) -> float:
        """Time of the last sample before a block [s]."""
        return (block * self._scenario.block_size - 1) / self._scenario.sample_rate

    def _along_the_path(self, block: int) -> Reference:
        times = block_times(block, self._scenario.block_size, self._scenario.sample_rate)
        name, self._to_name = self._to_name, ""  # said once; whoever sets another controller keeps it
        return Reference(DISPLACEMENT, times, self._path.value(times), name)

    @property
    def _in_words(self) -> str:
        what = "the stage is being poled" if self.doing == "pole" else "a trajectory is followed"
        return f"{what} for another {self.left:.1f} s"

    def _refuse_what_cannot_be(self, path: Path) -> None:
        times = _looked_at(path, self._now, self._scenario.sample_rate)
        places = path.value(times)
        places[0] = here = float(self._path.value(times[:1])[0])  # the path may begin with a jump
        time, voltage = self._applied
        _, now = self._model.step(self._state, Signals(np.array([time]), np.array([voltage])))
        # The stage is not where the model is; what the model reads more now is taken for what it will read more.
        more = float(now.displacement[-1]) - here
        asked = Signals(times, displacement=places + more)
        limits = self._scenario.limits
        found = forecast(
            self._model, self._state, asked, self._scenario.bounds, last=self._applied, current=limits.current
        )
        if not found.feasible:
            note = f" (the model reads {1e6 * more:+.3f} um more than the reference)" if abs(more) > 1e-8 else ""
            raise BenchError(f"it cannot be followed: {found.in_words}{note}")

    def _warm_up(self) -> None:
        """Compile now what the first trajectory would have to wait for; no state is changed."""
        _, rest = self._model.step(self._state, Signals(REHEARSAL, np.zeros_like(REHEARSAL)))
        asked = Signals(REHEARSAL, displacement=rest.displacement)
        forecast(self._model, self._state, asked, self._scenario.bounds, last=self._applied, current=1.0)


def _looked_at(path: Path, begin: float, sample_rate: float) -> Array:
    """Sample times [s] from `begin` to the end of the path: evenly, and on both sides of every knot."""
    first, last = round(begin * sample_rate), int(np.ceil(path.end * sample_rate - 1e-6))
    evenly = np.linspace(first, last, min(LOOKED_AT, max(last - first, 0) + 1))
    knots = np.floor(path.time * sample_rate + 1e-6)
    places = np.unique(np.rint(np.concatenate((evenly, knots, knots + 1.0, [first + 1.0]))))
    return places[(places >= first) & (places <= max(last, first + 1))] / sample_rate


def conductor(scenario: Scenario, axis: str = "stage") -> Experiment | ManualConductor:
    """Who says what is asked of the stage: the scenario's phases, or an operator."""
    if scenario.manual is None:
        return scenario.experiment()
    return ManualConductor(scenario, scenario.manual, axis)
