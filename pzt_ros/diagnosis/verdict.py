"""The verdict of a diagnosis, in a few sentences."""

from __future__ import annotations

from collections.abc import Sequence

from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.outcome import Errors
from pzt_ros.diagnosis.remains import Remains
from pzt_ros.diagnosis.report import FoundEffect
from pzt_ros.diagnosis.wandering import size_of, wanders

TIME = " The time limit of {:.4g} s was reached before all was tried; more time may find more."

SILENT = {
    False: "Nothing is missing that these runs show",
    True: "No effect shows itself, but the train runs do not determine the density where the test runs go",
}


def verdict_of(
    effects: Sequence[FoundEffect],
    tied: Sequence[Sequence[str]],
    remains: Remains,
    errors: tuple[Errors, Errors],
    tested: bool,
    silent: str,
) -> str:
    """What is missing, what ties and what is left, each in a sentence.

    Args:
        effects, tied, remains: as a report states them.
        errors: before and after.
        tested: whether there are test runs.
        silent: what to say where nothing is missing; empty where something is.
    """
    before, after = errors
    which = "runs not fitted" if tested else "the train runs"
    way = "falls" if after.test <= before.test else "rises"
    fall = f"the error on {which} {way} from {before.test * 1e9:.4g} to {after.test * 1e9:.4g} nm rms"
    sentences = []
    if effects:
        sentences.append(f"Missing: {', '.join(_words(e.name) for e in effects)}; {fall}")
    if silent:
        sentences.append(f"{silent}: {remains.times_noise:.2f} x the noise floor is left")
    if tied:
        either = " or ".join(_words(name) for name in tied[0])
        same = effects or after is before
        why = ", which could hide there" if silent else ""
        sentences.append(f"Not identifiable from this data{why}: {either}" + ("" if same else f"; {fall}"))
    if remains.present:
        start = "Something is missing that is not named" if not (effects or tied) else "Something unexplained remains"
        sentences.append(f"{start}: {remains.what_is_seen}")
    return ". ".join(sentences) + "."


def by_chance(found: Hypothesis, remains: Remains, after: Errors) -> str:
    """A further sentence of the verdict where readings wander."""
    if not wanders(found):
        return ""
    size = size_of(found, after.residuals) * 1e9
    return (
        f" The drift goes by chance, {size:.3g} nm rms within a run, and stays in every prediction; beside it"
        f" {remains.times_noise:.2f} x the noise floor is left."
    )


def _words(name: str) -> str:
    return name.replace("_", " ")
