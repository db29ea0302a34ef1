"""Many diagnoses that have nothing to do with one another: the axes of a machine, or one axis week by week."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pzt_ros.diagnosis.diagnose import diagnose
from pzt_ros.diagnosis.report import Report
from pzt_ros.errors import BenchError
from pzt_ros.parallel import IN_THIS_PROCESS, Workers
from pzt_ros.physics.chain import Chain
from pzt_ros.records import Record


@dataclass(frozen=True)
class Job:
    """What one diagnosis is given.

    Attributes:
        train, test: runs.
        chain: declared; one in proportion to the runs where None.
        command: that asked for it, for the report.
    """

    train: Sequence[Record]
    test: Sequence[Record]
    chain: Chain | None = None
    command: str = ""


def diagnose_many(jobs: Sequence[Job], workers: Workers) -> Iterator[Report | BenchError]:
    """The report of each job in their order, or why there is none: bad runs of one axis do not stop the others.

    Each is made on one core of one worker.
    """
    return iter(workers.map(_diagnosed, jobs))


def _diagnosed(job: Job) -> Report | BenchError:
    try:
        return diagnose(job.train, job.test, job.chain, command=job.command, workers=IN_THIS_PROCESS)
    except BenchError as error:
        return error
