"""Small scenarios for the graph tests.

Late commands are only counted: these tests run on machines that do other things, too; test_pace.py has the budget.
"""

from __future__ import annotations

from pathlib import Path

SHORT = """
scenario: short
plant: bench-stage
model: thesis-p2
block_size: 100
seed: 7
limits: {late_commands: 0, command_timeout: 6 s}
phases:
  - {phase: voltage, to: 120 V, duration: 0.3 s}
  - {phase: voltage, to: 20 V, duration: 0.2 s, shape: linear}
  - {phase: move, to: 4 um, duration: 0.1 s, controller: open_loop}
  - {phase: scan, low: 4 um, peak_to_peak: 5 um, frequency: 10 Hz, cycles: 1, controller: pi}
  - {phase: scan, low: 4 um, peak_to_peak: 5 um, frequency: 10 Hz, cycles: 1, controller: inverse}
  - {phase: scan, low: 4 um, peak_to_peak: 5 um, frequency: 10 Hz, cycles: 2, controller: inverse_pi}
  - {phase: voltage, to: 0 V, duration: 1.5 s}
"""

LONG_HOLD = """
scenario: long hold
plant: bench-stage
model: thesis-p2
limits: {late_commands: 0, command_timeout: 6 s}
phases:
  - {phase: voltage, to: 100 V, duration: 0.2 s}
  - {phase: voltage, to: 100 V, duration: 600 s}
"""

POLED_QUICKLY = """
scenario: manual, poled quickly
plant: bench-stage
model: thesis-p2
seed: 3
rate: real time
controllers: {inverse_pi: {integral_gain: 100 1/s}}
limits: {command_timeout: 2 s, late_commands: 0}
manual: {poling_ramp: 0.3 s, poling_hold: 0.2 s}
"""


def write(folder: Path, text: str) -> Path:
    """A scenario file in `folder`."""
    path = folder / "scenario.yaml"
    path.write_text(text, encoding="utf-8")
    return path
