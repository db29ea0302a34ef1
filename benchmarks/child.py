"""A measurement in a process of its own: nothing compiled, nothing in memory before."""

from __future__ import annotations

import json
import os
import subprocess
import sys

from pzt_ros.errors import RunFailedError


def measured_in_child(module: str, *arguments: str, **environment: str) -> dict[str, float]:
    """What `python -m module arguments` prints as JSON.

    Raises:
        RunFailedError: it failed; its own words went to the terminal.
    """
    command = [sys.executable, "-m", module, *arguments]
    done = subprocess.run(command, env={**os.environ, **environment}, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        raise RunFailedError(f"{module} {' '.join(arguments)} ended with code {done.returncode}; its message is above")
    found: dict[str, float] = json.loads(done.stdout)
    return found
