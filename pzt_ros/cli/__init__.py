"""`pzt`: the command line. Each file of this folder holds the commands of one subject."""

from __future__ import annotations

from pzt_ros.cli.app import main

__all__ = ["main"]
