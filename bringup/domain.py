"""One ROS domain per bringup: a free one unless told otherwise, and never the same one twice."""

from __future__ import annotations

import fcntl
import os
import random
import socket
from typing import IO

from pzt_ros.errors import BenchError
from pzt_ros.graphs import lock_file

DOMAINS = range(0, 102)
"""Higher domains use ports that overlap the ephemeral range (docs/decisions/0003)."""


class DomainLock:
    """Holds a domain for as long as this process lives; the lock goes with the process, whatever happens to it."""

    def __init__(self, domain: int, file: IO[str]) -> None:
        self.domain = domain
        self._file = file

    def release(self) -> None:
        """Let others have the domain."""
        self._file.close()


def take_domain(wanted: int | None) -> DomainLock:
    """The domain asked for, or a free one.

    Raises:
        BenchError: out of range, or another bringup is running in it; or no domain is free.
    """
    if wanted is not None:
        if wanted not in DOMAINS:
            raise BenchError(f"ROS domain {wanted} is outside {DOMAINS[0]} to {DOMAINS[-1]}; choose one inside")
        lock = _lock(wanted)
        if lock is None:
            raise BenchError(
                f"ROS domain {wanted} is in use: another bringup{_holder(wanted)} runs in it;"
                " stop it or choose another --domain"
            )
        return lock
    # Not the one of a moment ago: participants that died uncleanly haunt a domain for seconds.
    start = random.randrange(len(DOMAINS))
    for domain in (*DOMAINS[start:], *DOMAINS[:start]):
        if domain == 0 or _is_occupied(domain):
            continue  # 0 is where everybody else's tools are by default
        lock = _lock(domain)
        if lock is not None:
            return lock
    raise BenchError("no free ROS domain between 1 and 101; stop another graph or name one with --domain")


def _lock(domain: int) -> DomainLock | None:
    try:
        file = open(lock_file(domain), "a+", encoding="utf-8")  # noqa: SIM115 - held open, that is the lock
    except OSError:  # another user's file: theirs is the domain
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        return None
    file.truncate(0)
    file.write(str(os.getpid()))
    file.flush()
    return DomainLock(domain, file)


def _holder(domain: int) -> str:
    try:
        return f" (process {lock_file(domain).read_text(encoding='utf-8').strip()})"
    except OSError:
        return ""


def _is_occupied(domain: int) -> bool:
    """Whether somebody's first participant listens in this domain (its unicast discovery port is taken)."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", 7410 + 250 * domain))
        except OSError:
            return True
    return False
