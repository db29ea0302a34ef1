"""Profile intervals of a hypothesis' parameters: what the runs allow, where a standard error may say anything.

A share that ends at 1, or a delay that a bandwidth stands for, has a standard error without meaning and a useful bound.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.outcome import model_error
from pzt_ros.diagnosis.report import Report
from pzt_ros.sysid.profile import BetterFitError, Interval, Profile

_ROUNDS = 3


def note_intervals(report: Report, final: Hypothesis) -> None:
    """Write the intervals of its effects' parameters into a report and its model: `interval_95`, beside value and std.

    None stands for an end that lies beyond the parameter's bound.
    """
    noted = report.model.notes["fit"]["parameters"]  # the effects of the report hold the same entries
    for name, interval in intervals(final, final.effects).items():
        noted[name]["interval_95"] = [interval.lower, interval.upper]


ANY_POLARIZATION = (
    "How much polarization makes the displacement was neither recorded nor declared: parameters in units of"
    " polarization hold for as much as was assumed, and only their ratios are found."
)


def of_any_polarization(report: Report) -> Report:
    """The report of runs that do not say how large the polarization is, without errors of what hangs on that.

    A remark says so where a parameter of an effect is such.
    """
    parameters = [chain.notes["fit"]["parameters"] for chain in (report.baseline, report.model)]
    for entry in (entry for found in parameters for entry in found.values() if "C" in entry["unit"]):
        entry["std"] = None
        entry.pop("interval_95", None)
    named = any("C" in entry["unit"] for effect in report.effects for entry in effect.parameters.values())
    return replace(report, remarks=(*report.remarks, ANY_POLARIZATION)) if named else report


def intervals(found: Hypothesis, links: Collection[str]) -> dict[str, Interval]:
    """95 % intervals [SI] of the stage's parameters of some links, by `link.parameter`.

    Empty where refits go on finding better fits: then the misfit has more valleys than the search has seen.

    Args:
        found: refitted, with its ceramic exact where the fit ended.
        links: kinds, such as the names of its effects.
    """
    staged, vector = found.staged, found.solution.vector
    first = staged.start.size - len(staged.coordinates)
    asked = [
        (place, each)
        for place, each in enumerate(staged.coordinates, start=first)
        if each.kind in links and each.run is None
    ]
    for _ in range(_ROUNDS):
        profile = Profile(staged, vector, staged.bounds, staged.prior, widened=model_error(found))
        try:
            return {each.name: profile.interval(place).through(each.si) for place, each in asked}
        except BetterFitError as better:
            vector = better.args[0]
    return {}
