"""What a drawn figure consists of: the picture, and what was found in its data against the thesis' words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

AGREES, DIFFERS, NOT_SHOWN = "agrees", "differs", "not shown"


@dataclass(frozen=True)
class Finding:
    """One statement of the thesis against the drawn data.

    Attributes:
        claim: what the thesis says, short.
        found: what the drawn data say, with the numbers; or why they cannot say anything.
        holds: whether that is the same; None where the drawing cannot show it.
    """

    claim: str
    found: str
    holds: bool | None

    @property
    def verdict(self) -> str:
        """In a word."""
        return NOT_SHOWN if self.holds is None else AGREES if self.holds else DIFFERS


def near(claim: str, value: float, expected: float, tolerance: float, unit: str) -> Finding:
    """A number of the thesis against ours; `tolerance` relative, both numbers in `unit`."""
    found = f"{value:.3g} {unit} where the thesis has {expected:g}; taken as agreeing within {100 * tolerance:g} %"
    return Finding(claim, found, bool(abs(value - expected) <= tolerance * abs(expected)))


def below(claim: str, what: str, value: float, limit: float, unit: str = "%") -> Finding:
    """A number that the thesis calls small, against the limit that we take for small."""
    return Finding(claim, f"{what} {value:.3g} {unit}; taken as agreeing below {limit:g} {unit}", bool(value < limit))


@dataclass(frozen=True)
class Drawing:
    """A figure that was drawn.

    Attributes:
        figure: the picture, in the light theme's colours.
        findings: what was found in its data.
        note: what a reader has to know about how it was drawn.
    """

    figure: Figure
    findings: tuple[Finding, ...]
    note: str = ""


@dataclass(frozen=True)
class ThesisFigure:
    """A figure of the thesis and how we draw it.

    Attributes:
        number: as in the thesis, "2.4".
        title: what is seen.
        says: what the thesis shows and says of it, in our words.
        draw: makes the drawing from a number of samples per leg of the drive.
    """

    number: str
    title: str
    says: str
    draw: Callable[[int], Drawing]
