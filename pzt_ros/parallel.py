"""Where independent pieces of work are done: in this process, in threads, in processes, or by a Dask cluster.

Whatever takes `Workers` gives the same result to the bit wherever they work: pieces share nothing, their order stays.
"""

from __future__ import annotations

import asyncio
import importlib
import multiprocessing
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from importlib import metadata
from typing import Any, Protocol, TypeVar

from threadpoolctl import threadpool_limits as _threadpool_limits

from pzt_ros.errors import BenchError

threadpool_limits: Any = _threadpool_limits  # it carries no types

PATIENCE = 10.0
"""How long a Dask scheduler may take to answer, and its first worker to appear [s]."""

_MOST_THREADS = 4  # candidates that a diagnosis refits at once
_MATTERS = ("pzt_ros", "numpy", "scipy", "numba")  # packages whose version changes results, or whether pickles load

Item = TypeVar("Item")
Result = TypeVar("Result")

_alone = False  # whether this process is one of several that share the cores


class Workers(Protocol):
    """What pieces of work are given to; the executors of `concurrent.futures` are such."""

    def map(self, function: Callable[..., Result], /, *items: Iterable[Any]) -> Iterable[Result]:
        """`function` of each item, or of one of each of several iterables, in their order."""
        ...


class InThisProcess:
    """Works one by one, each when its result is asked for."""

    def map(self, function: Callable[..., Result], /, *items: Iterable[Any]) -> Iterable[Result]:
        """As the built-in."""
        return map(function, *items)


IN_THIS_PROCESS = InThisProcess()


@contextmanager
def processes(jobs: int) -> Iterator[Workers]:
    """Other processes of this machine, or this one alone where `jobs` is 0 or 1.

    Raises:
        BenchError: one of them died.
    """
    if jobs < 2:
        yield IN_THIS_PROCESS
        return
    context = multiprocessing.get_context("spawn")  # a fork would copy the locks of threads that it does not copy
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=_stay_on_one_core) as pool:
        try:
            yield pool
        except BrokenProcessPool:
            raise BenchError(f"one of {jobs} processes died, out of memory perhaps; try fewer --jobs") from None


@contextmanager
def threads(jobs: int | None = None) -> Iterator[Workers]:
    """Threads: for work on much shared data, most of it in compiled code that lets go of Python's lock.

    Args:
        jobs: pieces at once; as many as this process may use cores, four at most, where None.
    """
    count = min(len(os.sched_getaffinity(0)), _MOST_THREADS) if jobs is None else jobs
    if count < 2:
        yield IN_THIS_PROCESS
    else:
        with ThreadPoolExecutor(count) as pool:
            yield pool


@contextmanager
def on_one_core(wanted: bool = True) -> Iterator[None]:
    """Everything in this process on one core while it lasts, because other processes use the others."""
    global _alone
    before, _alone = _alone, wanted or _alone
    try:
        yield
    finally:
        _alone = before


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Linear algebra in one thread: in small solves several only wait for one another, for long beside another job."""
    with threadpool_limits(limits=1):
        yield


def own_threads(count: int) -> int:
    """How many of `count` threads a computation may start."""
    return 1 if _alone else count


def side_by_side(function: Callable[[Item], Result], items: Sequence[Item], jobs: int) -> list[Result]:
    """`function` of each item, in as many threads of this process as it may start: for what is too much to be sent."""
    with threads(own_threads(min(jobs, len(items)))) as pool:
        return list(pool.map(function, items))


def _stay_on_one_core() -> dict[str, str]:
    """Keep this process to one core for good; versions of what matters here."""
    global _alone
    _alone = True
    threadpool_limits(limits=1)
    return {name: metadata.version(name) for name in _MATTERS}


class _DaskWorkers:
    """A Dask client as `Workers`."""

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address

    def map(self, function: Callable[..., Result], /, *items: Iterable[Any]) -> Iterable[Result]:
        """Everything is sent at once, straight to the workers."""
        sent = [self._client.scatter(list(each), hash=False) for each in zip(*items, strict=False)]
        return self._results([self._client.submit(function, *each, pure=False) for each in sent])

    def _results(self, futures: list[Any]) -> Iterator[Any]:
        distributed: Any = importlib.import_module("distributed")
        try:
            for future in futures:
                yield future.result()
        except (distributed.KilledWorker, CancelledError, OSError) as error:
            raise BenchError(
                f"--dask {self._address}: lost its workers or the scheduler ({type(error).__name__});"
                " look into their logs, or leave --dask out"
            ) from None


@contextmanager
def dask_workers(address: str) -> Iterator[Workers]:
    """The workers of a Dask scheduler.

    Args:
        address: `tcp://HOST:PORT`.

    Raises:
        BenchError: Dask is not installed, the scheduler or its workers do not answer in time or have other versions.
    """
    if not re.fullmatch(r"(tcp|tls|ws|wss)://.+:\d+/?", address):
        raise BenchError(f"--dask {address}: is no address of a scheduler; it looks like tcp://HOST:8786")
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        raise BenchError(f"--dask {address}: Dask is not installed here; pip install 'pzt_ros[dask]'") from None
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, asyncio.TimeoutError) as error:
        raise BenchError(
            f"--dask {address}: no scheduler answers there within {PATIENCE:g} s ({type(error).__name__});"
            " start one with 'dask scheduler', or leave --dask out"
        ) from None
    with client:
        _check_workers(client, address)
        yield _DaskWorkers(client, address)


def _check_workers(client: Any, address: str) -> None:
    """Raise BenchError unless there is a worker, and all of them have what is installed here."""
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except asyncio.TimeoutError:  # not the built-in one before Python 3.11
        raise BenchError(
            f"--dask {address}: the scheduler has no worker after {PATIENCE:g} s; start some: 'dask worker {address}'"
        ) from None
    ours = {name: metadata.version(name) for name in _MATTERS}
    for worker, theirs in client.run(_stay_on_one_core, on_error="return").items():
        if isinstance(theirs, BaseException):
            raise BenchError(f"--dask {address}: worker {worker} cannot load pzt_ros ({theirs}); install it there")
        other = [f"{name} {theirs[name]}" for name in _MATTERS if theirs[name] != ours[name]]
        if other:
            raise BenchError(
                f"--dask {address}: worker {worker} has {', '.join(other)}, here it is"
                f" {', '.join(ours[each.split()[0]] for each in other)}; install the same versions"
            )
