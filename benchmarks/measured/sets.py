"""The run sets: which part of which file is fitted, which chooses, which scores; fixed before any score was looked at.

As in `pzt diagnose`, all of the train runs is fitted, the first half of the test run chooses, its second half scores.
Where both are one record that goes on, the bases run over it as a whole: then nothing about the start is unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pzt_ros.records import Record, read_csv


@dataclass(frozen=True)
class Cut:
    """Part of a file.

    Attributes:
        file: below the folder of the data.
        start, end: first and last time [s].
        means: samples that become one, their mean.
    """

    file: str
    start: float
    end: float
    means: int = 1

    def record(self, data: Path) -> Record:
        """The samples of the cut."""
        return averaged(read_csv(data / self.file).between(self.start, self.end), self.means)

    @property
    def words(self) -> str:
        """What a reader would have to cut out."""
        means = f", means of {self.means} samples" if self.means > 1 else ""
        return f"`{Path(self.file).name}` {self.start:g} to {self.end:g} s{means}"


def averaged(record: Record, count: int) -> Record:
    """Means of so many samples each; what is left over at the end is dropped."""
    if count == 1:
        return record
    size = len(record) // count * count
    columns = {name: np.mean(values[:size].reshape(-1, count), axis=1) for name, values in record.columns.items()}
    return Record(record.name, columns, record.warnings)


@dataclass(frozen=True)
class RunSet:
    """One actuator.

    Attributes:
        key, title: short name of its pictures, heading.
        source: where the data is from, its licence.
        train, test: the runs.
        chain: declared model, a shipped name; empty for the default of `pzt diagnose`.
        left_out: what is not looked at, and why.
        target: share of the span that issue 4 asks for [%]; 0 where it asks for none.
        goes_on: whether the test run is what follows on the only train run.
        ties: whether effects that one frequency cannot tell apart are compared, too.
    """

    key: str
    title: str
    source: str
    train: tuple[Cut, ...]
    test: Cut
    chain: str
    left_out: str
    target: float
    goes_on: bool = False
    ties: bool = False

    def whole(self, data: Path) -> Record:
        """Train and test run as the one record that they are."""
        (first,) = self.train
        return Cut(first.file, first.start, self.test.end, first.means).record(data)


_PICMA, _AFM, _BENDER = "picma-p885-micromanipulator/", "afm-x-stage-strain-gauge/", "piezo-bender-150V-1Hz/"
_PNZT = "pnzt-ceramic-strain-polarization/"
_ONSET = _BENDER + "sine_1Hz_150V_with_onset_step.csv"

PICMA = RunSet(
    key="picma",
    title="PICMA stack in a flexure",
    source="P-885.91, capacitive sensor, 200 Hz; yan9a/DiscreteBacklashOperator, MIT",
    train=(Cut(_PICMA + "sine_1Hz_full_scale.csv", 2.0, 20.0),),
    test=Cut(_PICMA + "sine_1Hz_amplitude_ramps.csv", 9.0, 26.0),
    chain="picma-p885",
    left_out=(
        "The start-up branch at the begin of each file, which no later cycle repeats, and seven cycles of the second"
        " that are all alike: so two of the decaying ones are in the half that chooses."
    ),
    target=0.30,
    ties=True,
)

AFM = RunSet(
    key="afm",
    title="Flexure axis of an AFM, strain gauge",
    source="0 to 150 V, point by point; angelut2012/TFAFM_mcu_gui, no licence",
    train=(Cut(_AFM + "triangle6_sine10_0_150V.csv", 0.0, 2893.1),),
    test=Cut(_AFM + "triangle6_sine10_0_150V.csv", 2893.2, 6000.0),
    chain="afm-x-axis",
    goes_on=True,
    left_out="Nothing: fitted on the six triangles, chosen on five sines, scored on five. The time axis is estimated.",
    target=0.30,
)

BENDER = RunSet(
    key="bender",
    title="Bender, steady cycles",
    source="±150 V, 5 kHz; chandratue/SmartHysteresis, no licence",
    train=(Cut(_ONSET, 4.5, 6.0, means=10),),
    test=Cut(_ONSET, 6.0, 7.0, means=10),
    chain="",
    goes_on=True,
    left_out="Everything before 4.5 s: rest, switch-on and what rings after it; see the next section.",
    target=0.08,
)

ONSET = RunSet(
    key="onset",
    title="Bender, switch-on",
    source=BENDER.source,
    train=(Cut(_ONSET, 4.5, 7.0),),
    test=Cut(_ONSET, 2.8, 4.0),
    chain="",
    left_out="The first 2.8 s of rest.",
    target=0.0,
)

CERAMIC = RunSet(
    key="pnzt",
    title="PNZT ceramic: displacement and polarization together",
    source="through the coercive field; mavasbel/matlab-preisach-model, no licence",
    train=(Cut(_PNZT + "loop_1Hz_1400V.csv", 0.0, 10.0), Cut(_PNZT + "loop_0p1Hz_1400V.csv", 0.0, 100.0)),
    test=Cut(_PNZT + "loop_1Hz_1000V.csv", 0.0, 10.0),
    chain="",
    left_out="",
    target=0.0,
)

SETS = (PICMA, AFM, BENDER, ONSET)
HOLD = Cut(_PNZT + "hold_10s_pulses_then_28s_zero.csv", 0.0, 100.0)
