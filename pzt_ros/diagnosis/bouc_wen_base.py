"""Elements that slip as the base: for stages whose hysteresis no density of relays describes.

A Bouc-Wen model does not close its minor loops, so that it is outside the family of Preisach models, whatever their
density; without a base that has this, what it does beyond them would hide every effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pzt_ros.diagnosis.coordinates import coordinate
from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.flexible import beside_the_rest, driven
from pzt_ros.diagnosis.from_rest import as_poled
from pzt_ros.diagnosis.histories import refitted_from
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.staged import Progress
from pzt_ros.physics.bouc_wen import BoucWen
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.sysid.run import Start, amplifier_gain

_POLARIZATION = 0.2  # C/m^2 over the range of the field, where no run says
_HEIGHTS = 0.02, 0.05  # of it
_FIELDS = ((0.06, 0.3), (0.3, 1.0))
"""Over which both begin to slip, in units of the range of the field; each pair begins a fit that lags, one that leads.
"""

_FREE = ("field_soft", "shape_soft", "field_hard", "shape_hard")
_STEPS, _PAST_STEPS = 40, 8


def fit_bouc_wen(declared: Hypothesis, progress: Progress) -> Hypothesis:
    """Fit two elements that slip and a strain law in place of the declared ceramic and its strain.

    Args:
        declared: the fitted declared model; what else is in its chain stays.
        progress: is told what is being done.

    Returns:
        The best of several fits. Runs that begin driven have one or two reversals before, which the fit finds: two
        numbers are all that elements remember.
    """
    progress("fitting elements that slip" + declared.beside)
    thickness, _, (low, high) = driven(declared)
    span = (high - low) / thickness
    plain = BoucWen(layer_thickness=thickness, susceptibility=_POLARIZATION / span)
    starts = [
        replace(
            plain,
            field_soft=soft * span,
            field_hard=hard * span,
            height_soft=sign * _HEIGHTS[0] * _POLARIZATION,
            height_hard=sign * _HEIGHTS[1] * _POLARIZATION,
        )
        for soft, hard in _FIELDS
        for sign in (1.0, -1.0)
    ]
    ends = (low, high) if declared.staged.has_past else (low,)
    tried = (_fitted_from(declared, link, span, end) for link in starts for end in ends)
    return as_poled(_with_other_pasts(min(tried, key=lambda each: each.total), ends))


def elements_beside(found: Hypothesis, progress: Progress, settled: float) -> Hypothesis:
    """Elements fitted anew beside effects, from everywhere, where a run is left at more than `settled` times its noise.

    Those that were fitted without an effect have bent for it, and stay so beside it.
    """
    return found if max(found.ratios) <= settled else fit_bouc_wen(found, progress)


def _with_other_pasts(found: Hypothesis, ends: Sequence[float]) -> Hypothesis:
    """With one or two other reversals before each run that begins driven, where that leaves less.

    Args:
        found: with one reversal before each.
        ends: of the voltage across the ceramic [V].
    """
    gain = amplifier_gain(found.staged.chain)
    low, high = min(ends) / gain, max(ends) / gain
    for number, run in enumerate(found.staged.runs):
        if run.begins_driven:
            first = float(run.record.voltage[0])
            pasts = (low,), (high,), (low, 0.5 * (first + high)), (high, 0.5 * (first + low))
            again = [refitted_from(found, {number: Start(past)}, _PAST_STEPS) for past in pasts]
            found = min((found, *again), key=lambda each: each.total)
    return found


def _fitted_from(declared: Hypothesis, link: BoucWen, span: float, reversal: float) -> Hypothesis:
    """The fit that begins with given elements, runs that begin driven behind a reversal [V across the ceramic].

    The range of the field [V/m] scales how heights grow with it.
    """
    runs = declared.staged.runs
    coordinates = [coordinate(link, field) for field in _FREE]
    coordinates += [coordinate(link, field, _POLARIZATION) for field in ("height_soft", "height_hard")]
    coordinates.append(coordinate(link, "growth", 1.0 / span))
    if any(run.has_polarization for run in runs):  # displacement alone cannot tell the scale of P from the law's
        coordinates.append(coordinate(link, "susceptibility"))
    gain, records = amplifier_gain(declared.staged.chain), [run.record for run in runs]
    past = Start((reversal / gain,))
    starts = [past if run.begins_driven else Start() for run in runs]
    ceramic = DeclaredHysteresis(link, link, coordinates, records, starts, gain)
    motion = max(float(np.ptp(run.record.displacement)) for run in runs)
    staged, start = beside_the_rest(declared, ceramic, StrainLaw(linear=motion / _POLARIZATION, quadratic=0.0), 2)
    return fitted(staged, start, declared.effects, most_steps=_STEPS)
