"""The bringup as a process under test; it lives where the long series are run from, too."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from pzt_benchmarks.soak.processes import PATIENCE, GraphProcess, alive, free_domain, wait_until

__all__ = ["PATIENCE", "GraphProcess", "alive", "free_domain", "said_beside", "wait_until"]


def said_beside(graph: GraphProcess, program: Sequence[str], environment: Mapping[str, str]) -> Any:
    """What a Python program beside a graph says, as JSON; then Ctrl-C for the graph. Both have to end well."""
    done = subprocess.run(
        [sys.executable, *program], env=environment, capture_output=True, text=True, timeout=200.0, check=False
    )
    graph.interrupt()
    code, said = graph.wait()
    assert done.returncode == 0, done.stderr
    assert code == 0, said
    return json.loads(done.stdout)
