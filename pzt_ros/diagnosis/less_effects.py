"""Runs without what effects add to their readings: what is left is the ceramic's and its law's alone."""

from __future__ import annotations

from dataclasses import replace

from pzt_ros.diagnosis.data import RunData
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.signals import Array


def less_effects(found: Hypothesis) -> list[RunData]:
    """The runs with readings less what the effects behind the ceramic add to them, as the model has it."""
    behind = _behind(found)
    if not behind:
        return list(found.staged.runs)
    bare, vector = found.staged.without_all(behind, found.vector)
    numbers = range(len(bare.runs))
    pairs = zip(found.staged.outputs(found.vector, numbers), bare.outputs(vector, numbers), strict=True)
    return [
        _less(run, y - bare_y, p - bare_p)
        for run, ((y, p), (bare_y, bare_p)) in zip(found.staged.runs, pairs, strict=True)
    ]


def ceramic_alone(found: Hypothesis) -> Hypothesis:
    """The same without effects, as far from runs of the ceramic alone as it is from its own.

    Those have the voltage across it, and readings less what effects behind it add. Itself where it has no effects, or
    an amplifier, which takes pasts to the ceramic as well.
    """
    if not found.effects or any(isinstance(link, Amplifier) for link in found.staged.chain.links):
        return found
    bare, vector = found.staged.without_all(found.effects, found.vector)
    driven = zip(less_effects(found), found.staged.voltages(found.vector), strict=True)
    runs = [_with(run, voltage_V=voltage) for run, voltage in driven]
    return fitted(replace(bare, runs=runs), vector, most_steps=0)


def _behind(found: Hypothesis) -> list[str]:
    return [name for name in found.effects if not found.staged.is_before(name)]


def _less(run: RunData, displacement: Array, polarization: Array) -> RunData:
    """A run without what is added to its readings [m, C/m^2, each shape (n,)]."""
    columns = {"displacement_m": run.record.displacement - displacement}
    if run.record.polarization is not None:
        columns["polarization_C_per_m2"] = run.record.polarization - polarization
    return _with(run, **columns)


def _with(run: RunData, **columns: Array) -> RunData:
    """A run with other columns."""
    return replace(run, record=replace(run.record, columns={**run.record.columns, **columns}))
