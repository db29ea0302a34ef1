"""What a story came to, in sentences for somebody who reads nothing else."""

from __future__ import annotations

import math
import re

from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.report.verdict import nanometres
from pzt_ros.story.outcome import AMONG, NAMED, NOTHING, PAIR, SOMETHING, Story
from pzt_ros.story.runs import FITTED, REPAIRED


def headline(story: Story) -> str:
    """What the diagnosis answered, and whether that is what was hidden."""
    hidden = plain(story.hidden.kind)
    found = [plain(effect.name) for effect in story.report.effects]
    if story.answer == NAMED:
        return f"The diagnosis named {hidden}, and {hidden} is what the stage hid."
    if story.answer == AMONG:
        beside = [name for name in found if name != hidden]
        more = f" It also added {' and '.join(beside)}, which was not hidden." if beside else ""
        for group in story.report.not_identifiable:
            more += f" It also suspected {' or '.join(map(plain, group))}, which was not hidden."
        rest = " Something is left that it could not explain." if story.report.remains.present else ""
        return f"The diagnosis named {hidden}, and {hidden} is what the stage hid.{more}{rest}"
    if story.answer == PAIR:
        group = next(g for g in story.report.not_identifiable if story.hidden.kind in g)
        either = " or ".join(plain(name) for name in group)
        return f"The diagnosis answered “{either}, these runs cannot tell”; the stage hid {hidden}."
    if story.answer == SOMETHING:
        return f"The diagnosis saw that something is missing and could not name it; the stage hid {hidden}."
    if story.answer == NOTHING:
        return f"The diagnosis found nothing missing, but the stage hid {hidden}."
    named = " and ".join(found or [" or ".join(map(plain, group)) for group in story.report.not_identifiable])
    return f"The diagnosis was wrong: it named {named}, and the stage hid {hidden}."


def outcome(story: Story) -> str:
    """Both errors before and after the repair."""
    before, after = story.predictions[FITTED].rms, story.predictions[REPAIRED].rms
    parts = [f"the error of prediction {_moved(before, after)}"]
    for name in story.controllers:
        was, now = story.tracking[FITTED][name].rms, story.tracking[REPAIRED][name].rms
        parts.append(f"the tracking error of {name} {_moved(was, now)}")
    return f"In simulation, {', '.join(parts[:-1])} and {parts[-1]}."


def gain(value: float) -> str:
    """A ratio as text, two digits, three from 100 on; - where it is none."""
    return "-" if not math.isfinite(value) else f"{value:.3g}" if value >= 100 else f"{value:.2g}"


def plain(name: str) -> str:
    """The name of an effect as words."""
    return name.replace("_", " ")


def prose(text: str) -> str:
    """Text with the names of effects as words."""
    return re.sub("|".join(EFFECT_OF), lambda found: plain(found.group()), text)


def _moved(before: float, after: float) -> str:
    if after < before:
        return f"fell from {nanometres(before)} to {nanometres(after)} ({gain(before / after)} times)"
    return f"did not fall: {nanometres(before)} before, {nanometres(after)} after"
