"""Errors for the person at the bench: what happened, with which value, against which limit, what to do."""

from __future__ import annotations


class BenchError(Exception):
    """A mistake in what we were given; its text is one line, shown as it is with exit code 2."""

    exit_code = 2


class RunFailedError(BenchError):
    """The input was good, but the run did not end as it should; exit code 1."""

    exit_code = 1
