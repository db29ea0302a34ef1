"""The experiment that comes next: in words, and as the design of a drive where one is needed."""

from __future__ import annotations

from collections.abc import Sequence

from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.data import RunData
from pzt_ros.diagnosis.identifiability import DENSITY, Alike
from pzt_ros.diagnosis.next_experiment import Bench, Design, design_between, for_amplitudes, for_unexplained
from pzt_ros.diagnosis.remains import Remains
from pzt_ros.diagnosis.report import FoundEffect
from pzt_ros.effects.table import EFFECT_OF

_MORE_AMPLITUDES = "Minor loops at amplitudes and offsets between those of the train runs, which the density lacks."
_CONTACTS = "Check plugs, cables and the sensor's interface for what makes readings stand alone; then repeat a run."
_REPEAT = "Repeat the part named above as it was; then with the drive at rest; then at another rate and amplitude."


def what_next(
    effects: Sequence[FoundEffect],
    tied: Sequence[Sequence[str]],
    remains: Remains,
    sparse: bool,
    blind: Sequence[Alike],
) -> tuple[str, Design | None]:
    """What to do next in words, and the design of its drive where one is needed."""
    if tied:
        return design_between([name for name in tied[0] if name != DENSITY])
    if blind and not effects:
        return design_between(sorted(blind[0].effects))
    if sparse:
        return _MORE_AMPLITUDES, for_amplitudes
    if remains.only_spikes:
        return _CONTACTS, None
    if remains.present:
        return _REPEAT, for_unexplained
    if effects:
        return f"To confirm {effects[0].name}: {EFFECT_OF[effects[0].name].next_experiment}", None
    return "None needed: a run at another rate and amplitude would widen the range that this holds for.", None


def bench_of(chosen: Branch, runs: Sequence[RunData]) -> Bench:
    """What the runs and the effects that tie, as refitted, say about it."""
    alike = [c for step in chosen.steps for c in step.candidates if c.name in step.tied]
    chains = [(c.name, c.after.staged.chain_at(c.after.vector)) for c in alike]
    links = [link for name, chain in chains for link in chain.links if link.kind == name]
    return Bench.of([run.record for run in runs], links)
