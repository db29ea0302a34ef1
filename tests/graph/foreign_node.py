"""A node that is none of ours; it lives where the long series are run from, too."""

from pzt_benchmarks.soak.foreign import ForeignNode

__all__ = ["ForeignNode"]
