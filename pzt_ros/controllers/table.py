"""Every controller by name; a new one is one line here."""

from __future__ import annotations

from pzt_ros.controllers.controller import Controller
from pzt_ros.controllers.inverse import Inverse
from pzt_ros.controllers.inverse_pi import InversePI
from pzt_ros.controllers.learning import Learning
from pzt_ros.controllers.observer_inverse import ObserverInverse
from pzt_ros.controllers.open_loop import OpenLoop
from pzt_ros.controllers.pi import PI
from pzt_ros.controllers.pi_notch import NotchPI
from pzt_ros.controllers.receding_horizon import RecedingHorizon

CONTROLLERS: dict[str, type[Controller]] = {
    c.kind: c for c in (OpenLoop, PI, NotchPI, Inverse, InversePI, ObserverInverse, Learning, RecedingHorizon)
}
