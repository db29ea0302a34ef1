"""The bringup as a process under test; it lives where the long series are run from, too."""

from pzt_benchmarks.soak.processes import PATIENCE, GraphProcess, alive, free_domain, wait_until

__all__ = ["PATIENCE", "GraphProcess", "alive", "free_domain", "wait_until"]
