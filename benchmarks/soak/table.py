"""The fault table: every fault, in the order of the page."""

from __future__ import annotations

from pzt_benchmarks.soak.bag_faults import BAG_FAULTS
from pzt_benchmarks.soak.fault import Fault
from pzt_benchmarks.soak.file_faults import FILE_FAULTS
from pzt_benchmarks.soak.graph_faults import GRAPH_FAULTS
from pzt_benchmarks.soak.instrument_faults import INSTRUMENT_FAULTS
from pzt_benchmarks.soak.wire_faults import WIRE_FAULTS

FAULTS: tuple[Fault, ...] = WIRE_FAULTS + INSTRUMENT_FAULTS + GRAPH_FAULTS + FILE_FAULTS + BAG_FAULTS
