"""A node whose middleware never lets go of it does not stay behind."""

from __future__ import annotations

import signal
import subprocess
import sys

PROGRAM = """
import sys
from pzt_nodes import spin

class Node:
    def destroy_node(self):
        while sys.argv[1] == "hangs":
            pass

spin.LEAVE_DEADLINE = 1
spin.leave([Node()])
"""


def test_what_hangs_in_the_end_ends_the_process() -> None:
    for how, code in (("hangs", -signal.SIGALRM), ("goes", 0)):
        assert subprocess.run([sys.executable, "-c", PROGRAM, how], timeout=60).returncode == code
