"""Errors for the person at the bench: what happened, with which value, against which limit, what to do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

T = TypeVar("T")


class BenchError(Exception):
    """A mistake in what we were given; its text is one line, shown as it is with exit code 2."""

    exit_code = 2


def named(table: Mapping[str, T], name: str, what: str) -> T:
    """The entry of a table by its name.

    Raises:
        BenchError: there is none; says what kind of thing was asked for, and which there are.
    """
    if name not in table:
        raise BenchError(f"unknown {what} '{name}'; known are {', '.join(table)}")
    return table[name]


class RunFailedError(BenchError):
    """The input was good, but the run did not end as it should; exit code 1."""

    exit_code = 1
