"""What a diagnosis said about one case, beside what is true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from .cases import Spec
from .effects import INSIDE

RIGHT, WRONG, PARTLY, PAIR, OTHER_PAIR, UNEXPLAINED, SILENT, FAILED = (
    "right", "wrong name", "one of two", "pair", "other pair", "unexplained", "silent", "failed",
)  # fmt: skip
VERDICTS = (RIGHT, WRONG, PARTLY, PAIR, OTHER_PAIR, UNEXPLAINED, SILENT, FAILED)
"""right: exactly the hidden effects are named, and no pair beside. wrong name: one is named that is not there. one of
two: a part is named, nothing wrong. pair: a hidden effect is in a group that is called not identifiable. other pair: a
group, but none with what is hidden. unexplained: no name, something remains. silent: nothing is said to be missing.
failed: no report."""


@dataclass(frozen=True)
class Covered:
    """One parameter of an effect that was named rightly: truth, estimate, standard error [SI]."""

    effect: str
    parameter: str
    truth: float
    value: float
    std: float

    @property
    def inside(self) -> bool:
        """Whether the 95 % interval holds the truth."""
        return abs(self.value - self.truth) <= 1.96 * self.std


@dataclass(frozen=True)
class Outcome:
    """One line of the court's results.

    Attributes:
        name, kind, family, protocol: of the case.
        effects, size: hidden, and how large [noise].
        reached: size that the generator reached for each; far below `size` where the runs cannot show so much.
        named, groups, unexplained: as in report.json.
        seconds, megabytes: what the diagnosis took.
        before, after: error on each score run over the noise, of baseline.yaml and of model.yaml.
        parameters: see Covered.
        separated: whether the proposed next experiment, made, brought the right name; None where none was proposed.
        failure: why there is no report.
    """

    name: str
    kind: str
    family: str
    protocol: str
    effects: tuple[str, ...]
    size: float
    reached: tuple[float, ...] = ()
    named: tuple[str, ...] = ()
    groups: tuple[tuple[str, ...], ...] = ()
    unexplained: bool = False
    seconds: float = 0.0
    megabytes: float = 0.0
    before: tuple[float, ...] = ()
    after: tuple[float, ...] = ()
    parameters: tuple[Covered, ...] = ()
    separated: bool | None = None
    failure: str = ""

    @property
    def reachable(self) -> bool:
        """Whether the effect is as large as was asked."""
        return all(size > 0.8 * self.size for size in self.reached)

    @property
    def verdict(self) -> str:
        """One of VERDICTS."""
        if self.failure:
            return FAILED
        return verdict(self.effects, self.named, self.groups, self.unexplained)

    def as_data(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Outcome:
        """Back from JSON."""
        parameters = tuple(Covered(**each) for each in data.pop("parameters"))
        groups = tuple(tuple(group) for group in data.pop("groups"))
        plain = {key: tuple(value) if isinstance(value, list) else value for key, value in data.items()}
        return cls(**plain, parameters=parameters, groups=groups)


def outcome_for(spec: Spec, **found: Any) -> Outcome:
    """An outcome with what the case says of itself."""
    return Outcome(spec.name, spec.kind, spec.family, spec.protocol, spec.effects, spec.size, **found)


def verdict(hidden: Sequence[str], named: Sequence[str], groups: Sequence[Sequence[str]], unexplained: bool) -> str:
    """One of VERDICTS; an effect outside the library can only be named wrongly."""
    inside = set(hidden) & set(INSIDE)
    grouped = {name for group in groups for name in group}
    if set(named) - inside:
        return WRONG
    if named and set(named) < inside:
        return PARTLY
    if named and not groups:
        return RIGHT
    if grouped & inside - set(named):
        return PAIR
    if groups:
        return OTHER_PAIR
    if unexplained:
        return UNEXPLAINED
    return SILENT
