"""What a fit found: parameters with their uncertainty, misfit against the noise, and the chain to go on with."""

from __future__ import annotations

import math
import platform
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.noise import NoiseFloor
from pzt_ros.sysid.profile import Interval
from pzt_ros.sysid.run import Start, usual_past
from pzt_ros.sysid.start_notes import past_as_data, start_as_data

SETTLE_TIME = 1.0
"""How much of the start of an unknown run a prediction may look at for offset and history [s]."""

_STRONG_CORRELATION = 0.95


@dataclass(frozen=True)
class Estimate:
    """One fitted parameter [SI].

    Attributes:
        name, value, unit: of it.
        std: standard error; infinite where the runs do not determine it.
        at_bound: whether it ended at a bound of its declaration.
        interval: 95 %, from the profile of the misfit; None where that was not asked for, or not found.
    """

    name: str
    value: float
    std: float
    unit: str
    at_bound: bool
    interval: Interval | None = None

    def as_data(self) -> dict[str, Any]:
        """SI numbers; an end of the interval is null where the parameter's bound comes first."""
        found = {"value": self.value, "std": self.std, "unit": self.unit}
        if self.interval is None:
            return found
        return {**found, "interval_95": [self.interval.lower, self.interval.upper]}

    @property
    def interval_in_words(self) -> str:
        """Of the table; "at least" and "at most" where one end is the parameter's bound."""
        if self.interval is None:
            return "-"
        lower, upper = (None if end is None else f"{end:.4g}" for end in (self.interval.lower, self.interval.upper))
        if lower is None or upper is None:
            return f"at least {lower}" if lower else f"at most {upper}" if upper else "anything"
        return f"{lower} to {upper}"


@dataclass(frozen=True)
class RunFit:
    """How well one run is described.

    Attributes:
        name, sha256: of the record.
        start: history and offset as fitted.
        begins_driven: whether it has a past that nobody recorded.
        history_at_bound: whether a prior reversal ended where the search ends.
        counted_from, counted_until: part that counted [s].
        samples: residuals taken of it.
        rms: of the residual [m].
        span: peak to peak of the measurement [m].
        noise: floor of the measurement.
        correlation_time: over which the residual remembers itself [s].
    """

    name: str
    sha256: str
    start: Start
    begins_driven: bool
    history_at_bound: bool
    counted_from: float
    counted_until: float
    samples: int
    rms: float
    span: float
    noise: NoiseFloor
    correlation_time: float

    @property
    def times_noise(self) -> float:
        """Misfit in units of the noise floor; infinite on a record without noise."""
        return self.rms / self.noise.rms if self.noise.rms > 0.0 else math.inf


@dataclass(frozen=True)
class FitResult:
    """The outcome of `Fit.fit`.

    Attributes:
        chain: with the fitted values, not yet with notes on the fit.
        estimates: of the free parameters.
        correlation: of their errors [shape (p, p)].
        runs: one by one.
        held: parameters left as they were, because those before them act on these runs in the same way.
        evaluations: of the whole set of runs.
    """

    chain: Chain
    estimates: tuple[Estimate, ...]
    correlation: Array
    runs: tuple[RunFit, ...]
    held: tuple[str, ...]
    evaluations: int

    @property
    def strongly_correlated(self) -> list[tuple[str, str, float]]:
        """Pairs whose errors go together so closely (|r| > 0.95) that only a combination of them is known."""
        return [
            (a.name, b.name, float(self.correlation[i, i + 1 + j]))
            for i, a in enumerate(self.estimates)
            for j, b in enumerate(self.estimates[i + 1 :])
            if abs(self.correlation[i, i + 1 + j]) > _STRONG_CORRELATION
        ]

    @property
    def at_bounds(self) -> list[str]:
        """Parameters that ended at a bound; their standard error means little."""
        return [estimate.name for estimate in self.estimates if estimate.at_bound]

    def as_data(self, command: str = "") -> dict[str, Any]:
        """The `fit:` section of the model file, SI numbers with the unit in the name or beside them."""
        return {
            "command": command,
            "versions": versions(),
            "runs": [_run_as_data(run) for run in self.runs],
            "parameters": {e.name: e.as_data() for e in self.estimates},
            "correlated": [{"pair": [a, b], "r": round(r, 4)} for a, b, r in self.strongly_correlated],
            "correlation": [[round(float(r), 4) for r in row] for row in self.correlation],
            "at_bounds": self.at_bounds,
            "held": list(self.held),
        }

    def model(self, command: str = "") -> Chain:
        """The chain with notes on the fit and the rule by which a prediction starts."""
        past = usual_past([run.start for run in self.runs], [run.begins_driven for run in self.runs])
        start = {
            "runs": [start_as_data(run.start, run.sha256, run.name) for run in self.runs],
            "other": {"settle_s": SETTLE_TIME, **past_as_data(past)},
        }
        return replace(self.chain, notes={**self.chain.notes, "fit": self.as_data(command), "start": start})

    def __rich__(self) -> RenderableType:
        return Group(self._parameter_table(), self._run_table(), *map(Text, self._remarks()))

    def _parameter_table(self) -> Table:
        table = Table(title=f"{self.chain.name}: parameters", title_justify="left")
        remarks = [_remark(e) for e in self.estimates]
        rows = {
            "parameter": [e.name for e in self.estimates],
            "value": [f"{e.value:.5g}" for e in self.estimates],
            "± std": [f"{e.std:.2g}" if math.isfinite(e.std) else "-" for e in self.estimates],
            "95 %": [e.interval_in_words for e in self.estimates] if any(e.interval for e in self.estimates) else [],
            "unit": [e.unit for e in self.estimates],
            "remark": remarks if any(remarks) else [],
        }
        shown = {name: cells for name, cells in rows.items() if cells}
        for name in shown:
            words = name in ("parameter", "unit", "remark")
            table.add_column(name, justify="left" if words else "right", no_wrap=not words, overflow="fold")
        for row in zip(*shown.values(), strict=True):
            table.add_row(*row)
        return table

    def _run_table(self) -> Table:
        table = Table(title="runs", title_justify="left")
        for name in ("run", "counted [s]", "samples", "rms [nm]", "% of span", "noise floor [nm]", "x noise"):
            table.add_column(Text(name), justify="left" if name == "run" else "right", overflow="fold")
        for run in self.runs:
            table.add_row(
                Text(Path(run.name).name),
                f"{run.counted_from:.6g} to {run.counted_until:.6g}",
                str(run.samples),
                f"{run.rms * 1e9:.4g}",
                f"{100 * run.rms / run.span:.3g}",
                f"{run.noise.rms * 1e9:.3g}",
                f"{run.times_noise:.3g}",
            )
        return table

    def _remarks(self) -> list[str]:
        lines = [
            f"{Path(run.name).name}: started from {run.start}, offset {run.start.offset * 1e6:.4f} um"
            for run in self.runs
        ]
        lines += [f"{Path(run.name).name}: {run.noise.caveat}" for run in self.runs if run.noise.caveat]
        for run in self.runs:
            if run.history_at_bound:
                lines.append(
                    f"{Path(run.name).name}: a prior reversal is at the end of its range: as far out or further"
                )
        for a, b, r in self.strongly_correlated:
            lines.append(f"{a} and {b} go together (r = {r:.3f}): only a combination is known")
        if self.held:
            lines.append(f"held, as other parameters act alike on these runs: {', '.join(self.held)}")
        if any(run.times_noise > 1.2 for run in self.runs):
            lines.append(
                "the misfit exceeds the noise: something is missing in the chain, and std covers noise and correlation"
                " of the residual, not that"
            )
        return lines


def _remark(estimate: Estimate) -> str:
    if estimate.at_bound:
        return "at its bound"
    return "" if math.isfinite(estimate.std) else "not determined by these runs"


def versions() -> dict[str, str]:
    """Of what a result depends on."""
    packages = ("pzt_ros", "numpy", "scipy", "numba")
    return {"python": platform.python_version(), **{name: metadata.version(name) for name in packages}}


def _run_as_data(run: RunFit) -> dict[str, Any]:
    return {
        "name": run.name,
        "sha256": run.sha256,
        "from_s": run.counted_from,
        "until_s": run.counted_until,
        "samples": run.samples,
        "rms_m": run.rms,
        "span_m": run.span,
        "noise_rms_m": run.noise.rms,
        "noise_of_means_m": run.noise.of_means,
        "correlation_time_s": run.correlation_time,
        "history_at_bound": run.history_at_bound,
    }
