"""`python -m pzt_bringup`: see command.py."""

import signal

# Until there is something to stop, Ctrl-C just ends the program; the supervisor takes it over then.
signal.signal(signal.SIGINT, signal.SIG_DFL)

from pzt_bringup.nursery import prepare_nursery  # noqa: E402

prepare_nursery()  # beside the next line
from pzt_bringup.command import main  # noqa: E402 - it takes a second

main()
