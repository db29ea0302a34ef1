"""What a panel has to know of the axis that it stands before: the stack's geometry, and where it may be sent."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from pzt_ros.panel.motion import Envelope
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.signals import Rest, Signals

MARGIN = 0.03
"""Of the stroke, at either end: left for the feedback to work in."""

STROKES_PER_SECOND = 50.0
"""The whole stroke takes 20 ms or more: four blocks, the pace at which the graph's feedback works."""

LEG = 0.5
"""Time of a leg of the loop that the model is walked along [s], and its samples."""
LEG_SAMPLES = 250


def describe(model: Chain, voltage_min: float, voltage_max: float) -> dict[str, Any]:
    """Geometry of the stack [m] and the envelope of the panel's commands, for a page; of `model` after poling."""
    ceramic = next((link for link in model.links if isinstance(link, Ferroelectric)), None)
    length = next((link.active_length for link in model.links if hasattr(link, "active_length")), None)
    return {
        "layer_thickness_m": ceramic.layer_thickness if ceramic else None,
        "active_length_m": length,
        "envelope": asdict(envelope_of(model, voltage_min, voltage_max)),
    }


def envelope_of(model: Chain, voltage_min: float, voltage_max: float) -> Envelope:
    """Where the model goes between 0 V and the highest voltage once it has been poled.

    Negative voltage is left out: it would depole a part of what the next move counts on.
    """
    corners = [0.0, voltage_max, max(voltage_min, 0.0), voltage_max]
    count = LEG_SAMPLES * (len(corners) - 1)
    time = LEG * np.arange(1, count + 1) / LEG_SAMPLES
    voltage = np.interp(time, LEG * np.arange(len(corners)), corners)
    chain = model.behind_amplifier
    _, out = chain.step(chain.init(Rest()), Signals(time, voltage))
    travelled = out.displacement[LEG_SAMPLES:]
    low, high = float(travelled.min()), float(travelled.max())
    room = MARGIN * (high - low)
    return Envelope(low + room, high - room, STROKES_PER_SECOND * (high - low))
