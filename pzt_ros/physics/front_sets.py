"""Many parameter sets of the front model over one run, as a fit or a sensitivity study wants them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from pzt_ros.physics.front import Front
from pzt_ros.physics.signals import Rest, Signals


def step_all(models: Sequence[Front], rest: Rest, signals: Signals, threads: int = 1) -> Iterator[Signals]:
    """The block after each of the models, from rest, in their order.

    Results come one by one, so that 1000 of them need not fit into memory at once. The compiled loops release the
    lock of Python: two threads on two cores take half of the time.

    Raises:
        BenchError: as `Front.step`.
    """

    def after(model: Front) -> Signals:
        brief = replace(model)  # its tables go with it: those of 1000 models take 400 MB, and a tenth of the time
        return brief.step(brief.init(rest), signals)[1]

    if threads <= 1:
        yield from map(after, models)
        return
    with ThreadPoolExecutor(threads) as pool:
        for first in range(0, len(models), 4 * threads):  # a few at a time: results wait for whoever takes them
            yield from pool.map(after, models[first : first + 4 * threads])
