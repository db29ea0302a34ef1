"""Every controller by name; a new one is one line here."""

from __future__ import annotations

from pzt_ros.controllers.controller import Controller
from pzt_ros.controllers.inverse import Inverse
from pzt_ros.controllers.inverse_pi import InversePI
from pzt_ros.controllers.open_loop import OpenLoop
from pzt_ros.controllers.pi import PI

CONTROLLERS: dict[str, type[Controller]] = {c.kind: c for c in (OpenLoop, PI, Inverse, InversePI)}
