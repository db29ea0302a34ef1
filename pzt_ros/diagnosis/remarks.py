"""What a report remarks beside its verdict, in words: what was taken out of a fit, and what does not count."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pzt_ros.diagnosis.data import RunData
from pzt_ros.diagnosis.gaps import lost_turns
from pzt_ros.diagnosis.grain import was_grainy
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.shaped import is_shaped
from pzt_ros.diagnosis.wandering import wanders
from pzt_ros.effects.sensor_nonlinearity import SensorNonlinearity
from pzt_ros.sysid.spikes import told

WORSE = (
    "What explains most of the misfit where the model was fitted and chosen makes its prediction of the rest worse,"
    " {after:.4g} nm rms instead of {before:.4g}: so it is not named."
)
BESIDE = (
    "Beside what is named, {names} would explain more where the model was fitted and chosen, but make its prediction of"
    " the rest worse, {after:.4g} nm rms instead of {before:.4g}: so that is not named."
)
UNSTEADY = (
    "The phase of the tone wanders: as the first half of a run tells it, it makes the prediction of the rest worse,"
    " {after:.4g} nm rms instead of {before:.4g}. It is there all the same; for predictions take the model without it."
)
SPARSE = (
    "The identified density describes the train runs down to the noise, but not the test runs: it is not determined"
    " where those go. That asks for runs at more amplitudes and offsets, not for an effect."
)
PAST = (
    "What test runs leave is their pasts': the first half of each told its own, and the second half shows what that is"
    " off by. Told by whole runs, pasts leave nothing, so nothing is missing in the model. A record that begins"
    " earlier, or a full stroke before the run, avoids that."
)
_WANDERS = (
    "The readings wander by chance. That is taken out of the fit, so the model is not bent by it, but it stays in every"
    " prediction: no model foretells it. A temperature recorded beside the runs would tell whether it is the room."
)
_FADES = (
    "Runs begin in motion, and the structure still relaxes from what nobody recorded. That dies out, whatever it was:"
    " it is taken out of the fit, and a prediction takes it from the first half of a run. A rest before the run, or a"
    " record of it, avoids that."
)
LAW = (
    "The strain goes with other powers of the polarization than was declared: a law up to the third was fitted in its"
    " place. The curve of a sensor would look alike."
)
_GRAIN = (
    "The nodes of the declared quadrature are too few for these runs: its densities were put on a lattice, which the"
    " model keeps."
)
_SHAPED = (
    "The densities of coercive and interaction fields are no Gaussians: their skew and tails were fitted, too"
    " (coercive_field_skew, coercive_field_tail, interaction_field_tail and, where they prefer a direction,"
    " interaction_field_skew)."
)
INSTEAD = (
    "A density with a formula leaves something of its own beside what is named. The model has one that was identified"
    " about it, which leaves less, also where it was not fitted, and is the formula's where no run tells."
)
FORMULA = (
    "Densities with a formula describe these runs as well as the identified one that was searched on: with skew and"
    " tails, with fields that depend on one another, or of two kinds of domains. The model has those: they know where"
    " no run tells."
)
_LOAD = (
    "A load that does not yield in proportion, such as a contact that is lost, bends the displacement as the curve of a"
    " sensor does. A recorded force (force_N) would tell the two apart."
)
_LOST_TURNS = (
    "{name}: {count} samples do not count, because they follow gaps in which the drive turned: how far it went there is"
    " not in the record."
)
_REACHED = (
    "{name}: {count} samples at its beginning do not count, because they hang on how the stage was driven before it,"
    " which nobody recorded. A record that begins earlier, or a full stroke before the run, avoids that."
)


def of_readings(found: Hypothesis) -> list[str]:
    """What was taken out of the misfit of the runs and stays in their prediction."""
    fading = any(run.fades for run in found.staged.runs)
    return [*([_WANDERS] if wanders(found) else []), *([_FADES] if fading else [])]


def of_model(found: Hypothesis) -> list[str]:
    """What stands in the place of what was declared."""
    return [*([_GRAIN] if was_grainy(found) else []), *([_SHAPED] if is_shaped(found) else [])]


def of_names(names: Sequence[str], runs: Sequence[RunData]) -> list[str]:
    """What else might be behind a name that stands alone, and no run could show."""
    is_seen = all(run.record.force is not None for run in runs)
    return [_LOAD] if SensorNonlinearity.kind in names and not is_seen else []


def of_samples(runs: Sequence[RunData]) -> list[str]:
    """Of each run with samples that do not count, how many and why; gaps first, then readings that stand alone."""
    counts = {run.record.name: int(np.count_nonzero(lost_turns(run.record))) for run in runs}
    lost = [_LOST_TURNS.format(name=name, count=count) for name, count in counts.items() if count]
    reached = [_REACHED.format(name=run.record.name, count=run.since) for run in runs if run.since]
    return [*lost, *reached, *(f"{sentence}." for run in runs for sentence in told(run.record, run.spikes))]
