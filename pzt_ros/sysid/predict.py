"""Free-run prediction of a measured run: over the recorded voltage, never looking at the part that is predicted."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.signals import Array, Signals
from pzt_ros.quantities import parameters_of
from pzt_ros.records import Record
from pzt_ros.sysid.covariance import effective_samples
from pzt_ros.sysid.history_search import at_its_best, at_its_best_with, pays, settle
from pzt_ros.sysid.noise import noise_floor
from pzt_ros.sysid.parameters import without_noise
from pzt_ros.sysid.result import SETTLE_TIME
from pzt_ros.sysid.run import Span, Start, begins_driven, first_half, free_run, rms, typical_leg
from pzt_ros.sysid.run_in import fades
from pzt_ros.sysid.spikes import without_spikes
from pzt_ros.sysid.start import CountedPart, counted_part, dying_out, misfit_at, unreached_part, with_offset
from pzt_ros.sysid.start_notes import past_from_data, start_from_data
from pzt_ros.sysid.usual_fading import with_usual_fading

_FEWEST_TO_SETTLE = 8
_MOST_TO_SETTLE = 20_000
_MOST_BASES = 4  # pasts that a search for another begins from: none, as runs are poled, and as fitted runs began
_AS_USUAL = 1.1  # rms over noise up to which a run from rest begins with as many reversals as the fitted ones
_FAR_LESS = 0.5  # of what a poled past leaves, from which a run from rest may have been left within minor loops
_LEAST_SPREAD = 0.3  # of the largest value, where the fitted runs agree by chance or are few
_SOON = 0.1  # of what went before a run that is not known: it was not long after those that are
_UNIT = 1e-9  # [SI]; a difference in a linear parameter, where nothing is expected of it
_STEP = 1e-3  # of what a parameter may be off by: the same where something is


@dataclass(frozen=True)
class Prediction:
    """A predicted part of a run, and how far it is from the measurement.

    Attributes:
        signals: time, voltage, polarization, phase fraction and displacement of the part.
        start: history and offset that were used.
        rule: in words, where those came from.
        error: measurement minus prediction [m]; empty where the run has no measurement.
        span: peak to peak of the measurement in the part [m].
        noise: its noise floor [m].
        told: samples at its beginning from which the past was found; they are predicted, but count in no figure.
    """

    signals: Signals
    start: Start
    rule: str
    error: Array
    span: float
    noise: float
    told: int = 0

    @property
    def rms(self) -> float:
        """Of the error [m]."""
        return rms(self.error[self.told :])

    def as_data(self) -> dict[str, Any]:
        """For programs: SI with the unit in the name; the error figures are null without a measurement."""
        known = self.error.size > 0
        return {
            "from_s": float(self.signals.time[self.told]),
            "until_s": float(self.signals.time[-1]),
            "samples": int(self.signals.time.size) - self.told,
            "rms_m": self.rms if known else None,
            "max_m": float(np.max(np.abs(self.error[self.told :]))) if known else None,
            "nrmse": self.rms / self.span if known and self.span > 0.0 else None,
            "span_m": self.span if known else None,
            "noise_rms_m": self.noise if known else None,
            "offset_m": self.start.offset,
            "prior_voltage_V": list(self.start.prior_voltages),
            "approach_s": self.start.approach,
            "rule": self.rule,
        }

    def __str__(self) -> str:
        lines = [f"start: {self.rule}; {self.start}, offset {self.start.offset * 1e6:.4f} um"]
        found = self.as_data()
        if found["rms_m"] is None:
            return "\n".join([*lines, "no displacement_m in the run, so no error to state"])
        share = f", {100 * found['nrmse']:.3g} % of span" if found["nrmse"] is not None else ""
        times = f", {self.rms / self.noise:.3g} x noise floor of {self.noise * 1e9:.3g} nm" if self.noise > 0 else ""
        span = f"{found['from_s']:.6g} to {found['until_s']:.6g} s, {found['samples']} samples"
        lines.append(f"error: {self.rms * 1e9:.4g} nm rms{share}{times}; max {found['max_m'] * 1e9:.4g} nm ({span})")
        return "\n".join(lines)


def predict(chain: Chain, record: Record, span: Span = Span()) -> Prediction:  # noqa: B008 - frozen
    """Run the chain over the whole recorded voltage and keep one part.

    What a run that was not fitted has of its own, the past of one that begins driven or the course of its drift, comes
    from the first half of the samples up to the end of the part; they count in no figure then. Readings that stand
    alone count nowhere.

    Raises:
        BenchError: the part is empty, or the chain's `start:` is malformed.
    """
    model, (record, _) = without_noise(chain), without_spikes(record)
    first, after = span.of(record)
    start, rule, looked_at = _start_of(chain, model, record, span)
    told = min(max(looked_at - first, 0), after - first - 1)
    signals = free_run(model, record, start, slice(first, after), after)
    if "displacement_m" not in record.columns:
        return Prediction(signals, start, rule, np.empty(0), 0.0, 0.0)
    measured = record.displacement[first:after]
    error = measured - signals.displacement
    return Prediction(signals, start, rule, error, float(np.ptp(measured)), noise_floor(measured).rms, told)


def _start_of(chain: Chain, model: Chain, record: Record, span: Span) -> tuple[Start, str, int]:
    """History and offset for a run, in words by which rule, and how many of its samples told its past."""
    known = fitted_starts(chain)
    if record.sha256 in known:
        return known[record.sha256], "as fitted to this run", 0
    base, settle_time, expected, was_driven = _rule_for_others(chain, record, list(known.values()))
    if "displacement_m" not in record.columns:
        return base, "no measurement to take them from: the model's history, offset 0", 0
    has_past = bool(base.prior_voltages) and not begins_driven(record)
    is_poled = has_past or (was_driven and not begins_driven(record))
    look = _look_at(record, span, settle_time, list(expected), has_past or fades(model, record, is_poled))
    past, own = (counted_part(record, each, _MOST_TO_SETTLE, is_poled) for each in (look.past, look.own))
    noise = noise_floor(record.displacement).rms
    found = _past_of(model, past, base, list(known.values()), noise)
    start = _with_own_values(model, own, base, found, expected, noise)
    start = _told_together(model, own, base, start, expected, noise)
    late = _read_late(model, own, start, noise)
    if is_poled and late is start:
        late = with_usual_fading(model, own, start, list(known.values()), noise)
    return late, look.rule, look.told


def _read_late(model: Chain, counted: CountedPart, found: Start, noise: float) -> Start:
    """A run from rest whose past does not describe its beginning has its offset, and what dies out, from thereafter.

    What few reversals are off by, where a stage was left within minor loops, would go on as something that dies out:
    beside a creep the second half of a run was off by 2.5 x the noise.
    """
    left = 0.0 if begins_driven(counted.record) or not found.prior_voltages else rms(misfit_at(model, counted, found))
    return with_offset(model, unreached_part(counted), found) if left > _AS_USUAL * noise else found


def _told_together(
    model: Chain,
    counted: CountedPart,
    base: Start,
    found: Start,
    expected: Mapping[str, tuple[float, float]],
    noise: float,
) -> Start:
    """A start with its past and what acts on the ceramic moved together, or the usual one if what it has more pays not.

    As it is where no parameter of the run acts there. One that does says little before the past is known, and the past
    little before it is.
    """
    known = {name: each for name, each in expected.items() if 0.0 < each[1] < math.inf}
    acting = {name: each for name, each in known.items() if _acts_on_ceramic(model, name)}
    if not acting:
        return found
    starts = (_with_own_values(model, counted, base, base, expected, noise), found)
    usual, other = (at_its_best_with(model, counted, each, acting, noise) for each in starts)
    before, after = (misfit_at(model, counted, each) for each in (usual, other))
    more = other.unknowns - usual.unknowns
    is_better = pays(before, after, more) if more > 0 else rms(after) < rms(before)
    return other if is_better else usual


class _Look(NamedTuple):
    """What is looked at of a run that was not fitted.

    Attributes:
        past: for its history.
        own: for its offset and the parameters of its own.
        told: so many samples count in no figure for that.
        rule: in words.
    """

    past: Span
    own: Span
    told: int
    rule: str


def _look_at(record: Record, span: Span, settle_time: float, own: Sequence[str], has_past: bool) -> _Look:
    """By whether a part is asked for, the run begins driven or with what relaxes, or has parameters of its own."""
    least = float(record.time[min(_FEWEST_TO_SETTLE, len(record)) - 1])
    if span.start is not None and span.start > least:
        before = Span(None, math.nextafter(span.start, -math.inf))
        return _Look(before, before, 0, f"from the part before {span.start:.6g} s")
    told = max(first_half(span.of(record)[1]), min(_FEWEST_TO_SETTLE, len(record) - 1))
    half = Span(None, math.nextafter(float(record.time[told]), -math.inf))
    until = f"from what comes before {record.time[told]:.6g} s"
    if begins_driven(record):
        return _Look(half, half, told, f"the run begins driven: its past {until}")
    if has_past:
        return _Look(half, half, told, f"the stage was driven before: its past {until}")
    end = max(float(record.time[0]) + settle_time, least)
    first, rule = Span(None, end), f"from the first {end - record.time[0]:.3g} s of the run"
    if not own:
        return _Look(first, first, 0, rule)
    if end >= record.time[told]:
        return _Look(half, half, told, until)
    return _Look(first, half, told, f"{rule}, {' and '.join(own)} {until}")


def _with_own_values(
    model: Chain,
    counted: CountedPart,
    base: Start,
    found: Start,
    expected: Mapping[str, tuple[float, float]],
    noise: float,
) -> Start:
    """A history with the run's own parameters and its offset.

    Reversals before a run from rest that stand for what these parameters do, such as a drift, are dropped.
    """

    def completed(start: Start) -> Start:
        return with_offset(model, counted, with_own_values_fitted(model, counted, start, expected, noise))

    more = found.unknowns - base.unknowns
    if not expected or not more or begins_driven(counted.record):
        return completed(found)
    plain, longer = completed(base), completed(found)
    before, after = (misfit_at(model, counted, start) for start in (plain, longer))
    return longer if pays(before, after, more) else plain


def _past_of(model: Chain, counted: CountedPart, base: Start, fitted: Sequence[Start], noise: float) -> Start:
    """As short a past as the samples ask for; hardly any of a run from rest, or one like that of the fitted runs."""
    if not begins_driven(counted.record):
        if base.occupancy:
            return base
        alike = _alike(model, counted, base) if base.prior_voltages else base
        if _is_as_usual(model, counted, alike, noise):
            return alike
        short = settle(model, counted, [base], noise=noise)
        if not base.prior_voltages or not short.prior_voltages:
            return short
        longer = at_its_best(model, counted, settle(model, counted, [base], noise=noise, is_alone=True))
        left = [rms(misfit_at(model, counted, start)) for start in (longer, short)]
        return longer if left[0] < _FAR_LESS * left[1] else short
    poled = [start.prior_voltages[0] for start in fitted if start.prior_voltages]
    pasts = [(), *([(float(np.median(poled)),)] if poled else []), *(start.prior_voltages for start in fitted)]
    bases = [replace(base, prior_voltages=past, approach=None) for past in dict.fromkeys(pasts)]
    found = settle(model, counted, bases[:_MOST_BASES], dying_out(model, counted), noise=noise)
    return at_its_best(model, counted, found)


def _alike(model: Chain, counted: CountedPart, base: Start) -> Start:
    """The past of the fitted runs, or as many reversals at other voltages and times where the samples ask for that."""
    other = at_its_best(model, counted, base)
    before, after = (misfit_at(model, counted, with_offset(model, counted, start)) for start in (base, other))
    return other if pays(before, after, base.unknowns) else base


def _is_as_usual(model: Chain, counted: CountedPart, base: Start, noise: float) -> bool:
    """Whether a past like that of the fitted runs, if they had one, describes the counted samples."""
    if not base.prior_voltages:
        return False
    return rms(misfit_at(model, counted, with_offset(model, counted, base))) <= _AS_USUAL * noise


def _expected(starts: Iterable[Start], name: str) -> tuple[float, float]:
    """What a parameter of a run is expected to be by the runs that were fitted: mean and spread [SI]."""
    values = [dict(start.values)[name] for start in starts if name in dict(start.values)]
    if not values:
        return 0.0, math.inf
    mean = float(np.mean(values))
    return mean, max(float(np.std(values)), _LEAST_SPREAD * float(np.max(np.abs(values))))


def with_own_values_fitted(
    chain: Chain, part: CountedPart, start: Start, expected: Mapping[str, tuple[float, float]], noise: float
) -> Start:
    """The start with the run's own parameters fitted to a part of it; the displacement is linear in them, or nearly.

    A short part tells a slow drift badly, and an error in its rate grows with the run; so the part is weighed against
    what is expected, by what the model leaves of it and how that remembers itself.

    Args:
        chain: that the run is predicted with.
        part: that may be looked at.
        start: history and offset.
        expected: mean and spread of each parameter [SI]; an infinite spread where nothing is.
        noise: of the displacement [m].
    """
    if not expected:
        return start
    names = list(expected)

    def displacement(values: Sequence[float]) -> Array:
        given = replace(start.without_reading, values=(*start.values, *zip(names, values, strict=True)))
        found = free_run(chain, part.record, given, part.picks, part.end).displacement
        return found - found.mean()

    mean, spread = (np.array([expected[name][k] for name in names]) for k in (0, 1))
    steps = np.where(np.isfinite(spread), np.maximum(_STEP * spread, _UNIT), _UNIT)
    there = displacement(list(mean))
    columns = np.column_stack([(displacement(list(mean + step)) - there) for step in np.diag(steps)]) / steps
    left = part.displacement - part.displacement.mean() - there
    free = left - columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
    seen = max(noise, rms(free) * math.sqrt(free.size / effective_samples(free)))
    with np.errstate(divide="ignore"):
        weight = np.where(spread > 0.0, seen / spread, 0.0)
    rows, targets = np.vstack((columns, np.diag(weight))), np.concatenate((left, np.zeros(mean.size)))
    values = mean + np.linalg.lstsq(rows, targets, rcond=None)[0]
    allowed = ((name, _allowed(chain, name, float(value))) for name, value in zip(names, values, strict=True))
    return replace(start, values=(*start.values, *allowed))


def _acts_on_ceramic(chain: Chain, name: str) -> bool:
    """Whether a parameter `link.field` belongs to a link before the ceramic."""
    kinds = [link.kind for link in chain.links]
    ceramic = next((place for place, link in enumerate(chain.links) if isinstance(link, Ferroelectric)), 0)
    return name.partition(".")[0] in kinds[:ceramic]


def _allowed(chain: Chain, name: str, value: float) -> float:
    """A parameter `link.field` within its declared bounds [SI]."""
    kind, _, field = name.partition(".")
    declared = next(parameters_of(link)[field] for link in chain.links if link.kind == kind)
    return min(max(value, declared.lower), declared.upper)


def fitted_starts(chain: Chain) -> dict[str, Start]:
    """The starts of the runs that a model was fitted to, by fingerprint of the run.

    Raises:
        BenchError: the chain's `start:` is not as a fit writes it.
    """
    notes = chain.notes.get("start", {})
    try:
        return {str(run["sha256"]): start_from_data(run) for run in notes.get("runs", [])}
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise _malformed(chain, error) from None


class _Rule(NamedTuple):
    """Of a run that was not fitted.

    Attributes:
        start: history to begin from.
        settle_time: how long its beginning is looked at [s].
        expected: mean and spread of parameters of its own [SI].
        was_driven: whether the stage was before the fitted runs, even where no reversals stand for that.
    """

    start: Start
    settle_time: float
    expected: dict[str, tuple[float, float]]
    was_driven: bool


def _rule_for_others(chain: Chain, record: Record, fitted: Sequence[Start]) -> _Rule:
    """By which a run that was not fitted begins.

    A parameter is expected as in the fitted runs. One that goes on from run to run is known of the runs that the
    diagnosis was given, and expected of others as it is after the last of those.
    """
    notes = chain.notes.get("start", {})
    try:
        rule = notes.get("other", {})
        past = past_from_data(rule, typical_leg(record))
        settle_time = float(rule.get("settle_s", SETTLE_TIME))
        occupancy = tuple(float(v) for v in rule.get("occupancy", ()))
        expected = {str(name): _expected(fitted, str(name)) for name in rule.get("per_run", ())}
        now = {f"{link.kind}.{field}": value for link in chain.links for field, value in vars(link).items()}
        going = {str(name): values for name, values in rule.get("goes_on", {}).items()}
        told = tuple((name, float(v[record.sha256])) for name, v in going.items() if record.sha256 in v)
        after = {name: float(now[name]) for name in going if name not in dict(told)}
        expected.update({name: (value, _SOON * value) for name, value in after.items()})
        was_driven = bool(rule.get("driven_before", False))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise _malformed(chain, error) from None
    return _Rule(replace(past, occupancy=occupancy, values=told), settle_time, expected, was_driven)


def _malformed(chain: Chain, error: Exception) -> BenchError:
    return BenchError(f"{chain.name}: 'start:' is not as pzt fit writes it ({error!r}); fit anew or remove it")
