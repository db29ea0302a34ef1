"""A case on disk: runs as CSV, the declared chain as YAML, and the truth in a file that only the court reads."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .cases import Case, Columns
from .families import LAYER, STROKE

Array = NDArray[np.float64]

_BOLTZMANN, _TEMPERATURE = 1.380649e-23, 293.0


@dataclass(frozen=True)
class CaseFiles:
    """Where a case lies.

    Attributes:
        folder: of the case.
        train, test, score: CSV files.
        declared: chain file that the diagnosis is told, or None.
    """

    folder: Path
    train: tuple[Path, ...]
    test: tuple[Path, ...]
    score: tuple[Path, ...]
    declared: Path | None


def write_case(case: Case, folder: Path) -> CaseFiles:
    """Write a case; the truth goes to `truth.json`."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = {}
    for part in ("train", "test", "score"):
        paths[part] = []
        for number, columns in enumerate(getattr(case, part), start=1):
            paths[part].append(folder / f"{part}-{number}.csv")
            write_run(paths[part][-1], columns)
    declared = None
    if case.spec.declared:
        declared = folder / "declared.yaml"
        declared.write_text(declared_chain(case), encoding="utf-8")
    (folder / "truth.json").write_text(json.dumps(case.truth(), indent=1), encoding="utf-8")
    return CaseFiles(folder, tuple(paths["train"]), tuple(paths["test"]), tuple(paths["score"]), declared)


def write_run(path: Path, columns: Columns) -> None:
    """A run as contract.md has it; numbers to 10 digits, which is far below the noise."""
    row = ",".join(["%.10g"] * len(columns)) + "\n"
    lines = map(row.__mod__, zip(*(values.tolist() for values in columns.values()), strict=True))
    path.write_text(",".join(columns) + "\n" + "".join(lines), encoding="utf-8")


def read_run(path: Path) -> Columns:
    """A run back from its file."""
    with path.open(encoding="utf-8") as stream:
        names = stream.readline().strip().split(",")
        table = np.loadtxt(stream, delimiter=",", ndmin=2)
    return {name: np.ascontiguousarray(table[:, place]) for place, name in enumerate(names)}


def declared_chain(case: Case) -> str:
    """Polycrystal on a lattice and electrostriction, every number 10 to 50 % off the truth.

    Where the truth is no Gaussian polycrystal, the numbers are those of a plausible one.
    """
    rng = np.random.default_rng([case.spec.seed, 13])
    p = case.bench.truth.parameters

    def off(value: float, least: float = 0.1, most: float = 0.5) -> float:
        factor = 1 + rng.uniform(least, most)
        return float(value * factor if rng.random() < 0.5 else value / factor)

    susceptibility = off(p.get("susceptibility", 0.018) * 1e-6, 0.1, 0.3)
    width = off(1e6 * p.get("thermal_width", 0.07), 0.0, 0.2)
    e1 = 1 / susceptibility
    law = getattr(case.bench.truth, "law", None)
    gain = law.gain if law else STROKE / 0.25**2
    values = {
        "coercive_field": (off(1e6 * p.get("coercive_field", 0.5)), "V/m"),
        "coercive_field_spread": (2 * off(1e6 * p.get("coercive_sigma", 0.45)) ** 2, "V^2/m^2"),
        "interaction_field_spread": (2 * off(1e6 * p.get("interaction_sigma", 0.45)) ** 2, "V^2/m^2"),
        "relaxation_time": (off(p.get("relaxation_time", 1e-3)), "s"),
        "domain_polarization": (0.26, "C/m^2"),
        "reciprocal_permittivity": (e1, "V*m/C"),
        "temperature": (_TEMPERATURE, "K"),
        "domain_volume": (2 * e1 * _BOLTZMANN * _TEMPERATURE / width**2, "m^3"),
        "layer_thickness": (LAYER, "m"),
        "spacing": (0.5, ""),
    }
    return _chain_text(
        [
            ("lattice", values),
            (
                "electrostriction",
                {"coefficient": (off(gain / 8e-3, 0.1, 0.4), "m^4/C^2"), "active_length": (8e-3, "m")},
            ),
        ]
    )


def _chain_text(links: Sequence[tuple[str, dict[str, tuple[float, str]]]]) -> str:
    lines = ["chain: declared", "links:"]
    for kind, values in links:
        lines.append(f"  - link: {kind}")
        lines += [f"    {name}: {value!r} {unit}".rstrip() for name, (value, unit) in values.items()]
    return "\n".join(lines) + "\n"
