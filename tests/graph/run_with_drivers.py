"""The bringup with drivers out of a file: `python run_with_drivers.py SCENARIO DRIVERS FOLDER DOMAIN`."""

from __future__ import annotations

import sys
from pathlib import Path

from pzt_bringup.domain import take_domain
from pzt_bringup.plan import RATES, Plan, prepare
from pzt_bringup.supervisor import Supervisor
from pzt_ros.hardware.choose import load_drivers
from pzt_ros.scenario import load_scenario


def main(scenario: str, drivers: str, folder: str, domain: str) -> int:
    """Run the graph; returns its exit code, and says how it ended on stderr."""
    lock = take_domain(int(domain))
    try:
        loaded, chosen = load_scenario(scenario), load_drivers(drivers)
        plan = Plan(loaded, Path(folder), False, RATES[0], None, lock.domain, drivers=chosen)
        prepare(plan)
        outcome = Supervisor(plan, lambda _: None).run()
    finally:
        lock.release()
    print(outcome.sentence, file=sys.stderr)
    return outcome.exit_code


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
