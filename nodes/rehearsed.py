"""What the bringup's nursery imports: all nodes, and compiled code of what is shipped if there is some."""

import atexit
import os

import pzt_nodes.composed  # noqa: F401 - imported to be there
from pzt_ros.first_run import rehearse

rehearse()
atexit.register(os._exit, 0)  # it has nothing to tidy up, and whoever waits for the end of its output should not wait
