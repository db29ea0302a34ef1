"""Many cases tried in parallel; what was tried already is not tried again."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import numpy as np

from .cases import KINDS, Spec, cases
from .outcome import Outcome


def chosen(kinds: Sequence[str], seed: int, sample: int | None, rounds: int | None = None) -> list[Spec]:
    """The cases of some tables; with `sample`, that many of each, drawn without regard to what they are."""
    found: list[Spec] = []
    for kind in kinds:
        table = cases(kind, seed, rounds)
        if sample is not None and sample < len(table):
            rng = np.random.default_rng([seed, list(KINDS).index(kind)])
            table = [table[k] for k in sorted(rng.choice(len(table), sample, replace=False))]
        found += table
    return found


def hold(
    specs: Sequence[Spec],
    trial: Callable[[Spec], Outcome],
    results: Path,
    workers: int,
    tell: Callable[[int, Outcome], None],
) -> list[Outcome]:
    """Try the cases and return their outcomes in the order given.

    Each outcome is a line of `results` as soon as it is there; cases that stand there already are not tried again, so
    a court that was interrupted goes on where it was.
    """
    known = {outcome.name: outcome for outcome in read_results(results)}
    left = [spec for spec in specs if spec.name not in known]
    results.parent.mkdir(parents=True, exist_ok=True)
    context = multiprocessing.get_context("spawn")
    with results.open("a", encoding="utf-8") as stream, ProcessPoolExecutor(workers, mp_context=context) as pool:
        running = [pool.submit(trial, spec) for spec in left]
        for number, done in enumerate(as_completed(running), start=1):
            outcome = done.result()
            known[outcome.name] = outcome
            stream.write(json.dumps(outcome.as_data()) + "\n")
            stream.flush()
            tell(len(left) - number, outcome)
    return [known[spec.name] for spec in specs]


def read_results(path: Path) -> list[Outcome]:
    """Outcomes written before; none where there is no such file."""
    if not path.exists():
        return []
    lines = path.read_text(encoding="utf-8").splitlines()
    return [Outcome.from_data(json.loads(line)) for line in lines if line.endswith("}")]
