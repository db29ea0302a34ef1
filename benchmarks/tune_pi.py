"""Finds what the demo's controllers are given: the straight line of open_loop, the gains of pi and inverse_pi.

Everything runs in the in-process loop on the demo's own stage, sensor noise and scan, so that the baselines are as good
as they get. The error is reference minus true displacement, as root mean square over the scan without its first cycle.

- open_loop: straight line by least squares, displacement over voltage, through the stage's own loop over the range of
  the scan, ten times slower than the scan. The stage's own chain as model makes it follow that range.
- pi: Kp and Ki on a grid, then three times on a finer grid around the best point; Kp = 0 is always a candidate.
- inverse_pi: Ki on one coarse grid with Kp = 0, no refinement.

    python -m pzt_benchmarks.tune_pi            # about four minutes; writes benchmarks/results/pi_tuning.csv
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from pzt_ros.controllers.controller import Controller
from pzt_ros.controllers.inverse import Inverse
from pzt_ros.controllers.inverse_pi import InversePI
from pzt_ros.controllers.open_loop import OpenLoop
from pzt_ros.controllers.pi import PI
from pzt_ros.experiments.phases import Move, Phase, Scan
from pzt_ros.hardware.guard import ENABLED
from pzt_ros.loop import InProcessLoop, Tick
from pzt_ros.quantities import parameters_of
from pzt_ros.report.tracking import TrackingError, stretches, track
from pzt_ros.scenario import Scenario, load_scenario

RESULT = Path(__file__).parent / "results" / "pi_tuning.csv"
COLUMNS = (
    "controller",
    "search",
    "proportional_gain",
    "integral_gain",
    "units",
    "rms_error_nm",
    "max_error_nm",
    "remark",
)

PI_KP = (0.0, 1e6, 2e6, 4e6, 8e6, 1.2e7, 1.6e7)
"""V/m; the stage gives about 1e-7 m/V, so 1e7 V/m is a loop gain near 1."""
PI_KI = (5e8, 1e9, 1.5e9, 2e9, 3e9, 4e9, 5e9, 7e9)
"""V/m/s."""
REFINEMENTS = (("refined by 1.2", 1.2), ("refined by 1.2 again", 1.2), ("refined by 1.07", 1.07))
INVERSE_PI_KI = (0.0, 5.0, 10.0, 20.0, 30.0, 50.0, 70.0, 100.0)
"""1/s; with one block (5 ms) of delay an integral alone is unstable from 314/s on; at 100/s the gain margin is 3."""


def phases_for(scenario: Scenario, controller: str) -> tuple[Phase, ...]:
    """The poling of the demo, then the move and the scan of one controller."""
    first = next(i for i, phase in enumerate(scenario.phases) if isinstance(phase, Move))
    own = next(
        i for i, phase in enumerate(scenario.phases) if isinstance(phase, Move) and phase.controller == controller
    )
    return scenario.phases[:first] + scenario.phases[own : own + 2]


def run(scenario: Scenario) -> tuple[list[Tick], str]:
    """The ticks of a scenario, and why the amplifier ended it early, if it did."""
    loop = InProcessLoop(scenario)
    ticks: list[Tick] = []
    tick: Tick | None = loop.start()
    while tick is not None:
        ticks.append(tick)
        if loop.amplifier.state != ENABLED:
            return ticks, loop.amplifier.reason
        tick = loop.step(tick)
    return ticks, ""


def with_controller(scenario: Scenario, controller: Controller) -> Scenario:
    """The demo cut down to one controller with these gains."""
    return dataclasses.replace(
        scenario,
        phases=phases_for(scenario, controller.kind),
        controllers={**scenario.controllers, controller.kind: controller},
    )


def scan_error(scenario: Scenario) -> tuple[TrackingError | None, str]:
    """Error over the scan without its first cycle, against the true displacement; and what went wrong, if it did."""
    ticks, reason = run(scenario)
    if reason:
        return None, reason
    time = np.concatenate([tick.truth.time for tick in ticks])
    truth = np.concatenate([tick.truth.displacement for tick in ticks])
    gap = np.full(scenario.block_size, np.nan)
    asked = [t.reference.values if t.reference and t.reference.quantity == "displacement" else gap for t in ticks]
    scan = next(s for s in stretches(scenario.experiment().spans()) if isinstance(s.phase, Scan))
    found = track(scan, time, np.concatenate(asked), {"truth": truth})
    return (found.settled["truth"], "") if found else (None, "nothing recorded")


class Search:
    """Tries gains and keeps a row for each."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.rows: list[dict[str, object]] = []
        self._errors: dict[Controller, float] = {}

    def best(self, candidates: Iterable[Controller], name: str) -> Controller:
        """The candidate with the least rms error; the ones tried before are not run again."""
        candidates = list(candidates)
        for controller in candidates:
            if controller not in self._errors:
                self._errors[controller] = self._try(controller, name)
        return min(candidates, key=lambda controller: self._errors[controller])

    def _try(self, controller: Controller, name: str) -> float:
        error, reason = scan_error(with_controller(self.scenario, controller))
        row: dict[str, object] = {
            "controller": controller.kind,
            "search": name,
            "proportional_gain": getattr(controller, "proportional_gain", ""),
            "integral_gain": getattr(controller, "integral_gain", ""),
            "units": ", ".join(p.unit for name, p in parameters_of(controller).items() if name in COLUMNS),
            "rms_error_nm": f"{1e9 * error.rms:.2f}" if error else "",
            "max_error_nm": f"{1e9 * error.maximum:.2f}" if error else "",
            "remark": reason,
        }
        self.rows.append(row)
        print(",".join(str(value) for value in row.values()), flush=True)
        return error.rms if error else np.inf


def straight_line(scenario: Scenario) -> OpenLoop:
    """The line through the stage's own slow loop over the scan's range, rounded to four digits."""
    scan = next(phase for phase in scenario.phases if isinstance(phase, Scan))
    slow = dataclasses.replace(scan, frequency=0.1 * scan.frequency, cycles=2.0)
    *before, _ = phases_for(scenario, "inverse")
    own = dataclasses.replace(
        scenario,
        model=scenario.plant,
        phases=(*before, slow),
        controllers={**scenario.controllers, "inverse": Inverse()},
    )
    ticks, reason = run(own)
    if reason:
        sys.exit(f"the slow loop failed: {reason}")
    second = ticks[-round(1.0 / slow.frequency * own.sample_rate / own.block_size) :]  # the first cycle is settling
    voltage = np.concatenate([tick.applied.voltage for tick in second])
    displacement = np.concatenate([tick.truth.displacement for tick in second])
    gain, at_zero = np.polyfit(voltage, displacement, 1)
    return OpenLoop(gain=float(f"{gain:.4g}"), voltage_at_zero=float(f"{-at_zero / gain:.4g}"))


def finer(centre: float, step: float) -> tuple[float, ...]:
    """Five values around `centre`, `step` apart as a factor; to three digits."""
    return tuple(float(f"{centre * step**k:.3g}") for k in (-2, -1, 0, 1, 2))


def tune(scenario: Scenario) -> tuple[list[dict[str, object]], list[Controller]]:
    """All rows, and the controllers chosen."""
    search = Search(scenario)
    line = search.best([straight_line(scenario)], "least squares")
    pi = search.best((PI(proportional_gain=p, integral_gain=i) for p in PI_KP for i in PI_KI), "grid")
    for name, step in REFINEMENTS:
        assert isinstance(pi, PI)
        kps = {0.0, *finer(pi.proportional_gain, step)}
        kis = finer(pi.integral_gain, step)
        pi = search.best((PI(proportional_gain=p, integral_gain=i) for p in sorted(kps) for i in kis), name)
    inverse = search.best([Inverse()], "no gains")
    inverse_pi = search.best((InversePI(integral_gain=i) for i in INVERSE_PI_KI), "grid")
    return search.rows, [line, pi, inverse, inverse_pi]


def main() -> None:
    """Search, write the CSV, print what belongs into the scenario."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="demo")
    parser.add_argument("--out", type=Path, default=RESULT)
    args = parser.parse_args()
    rows, chosen = tune(load_scenario(args.scenario))
    args.out.parent.mkdir(parents=True, exist_ok=True)
    with args.out.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    print(f"\nwritten: {args.out}; for the scenario:")
    for controller in chosen:
        print(" ", controller)


if __name__ == "__main__":
    main()
