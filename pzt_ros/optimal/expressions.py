"""The rates of `law.py` once more, as CasADi expressions: written apart, so that the two can check one another."""

from __future__ import annotations

import functools
from typing import Any

import casadi as ca

from pzt_ros.optimal.law import Material
from pzt_ros.optimal.memory import Mathematics, Run
from pzt_ros.physics.kinetics import _C, _CENTRE

_LEAST = 2e-12
"""erfinv of CasADi is no number at +-1; the arguments stay that far away from it."""


def place(y: Any) -> Any:
    """w with erfc(-w) = y."""
    return ca.erfinv(ca.fmin(ca.fmax(y - 1.0, _LEAST - 1.0), 1.0 - _LEAST))


EXPRESSIONS = Mathematics(ca.erf, place)


def _erfcx(a: Any) -> Any:
    """exp(a^2) erfc(a) for a >= 0; CasADi has none, so the polynomial of the kinetics."""
    y = (a - _CENTRE) / (a + _CENTRE)
    return functools.reduce(lambda sum_, c: sum_ * y + c, reversed(_C[:-1]), _C[-1]) / (1.0 + 2.0 * a)


def rate(z: Any) -> Any:
    """1/erfcx(z) for any z (3.9, 3.10)."""
    a = ca.fabs(z)
    g, e = _erfcx(a), ca.exp(-a * a)
    return ca.if_else(z >= 0.0, 1.0 / g, e / (2.0 - e * g))


@functools.lru_cache(maxsize=16)
def switching(m: Material) -> ca.Function:
    """dx/dt [1/s] of x+, the field [V/m] and a law of eight numbers."""
    x, field, law = ca.SX.sym("x"), ca.SX.sym("E"), ca.SX.sym("law", 8)
    up, down = (law[k] + law[k + 1] * place(law[k + 2] * x + law[k + 3]) for k in (0, 4))
    f = rate((field - up) / m.thermal_width) * (1.0 - x) - rate((down - field) / m.thermal_width) * x
    return ca.Function("switching", [x, field, law], [f / m.relaxation_time])


def law_at(run: Run, x: Any) -> Any:
    """The law that x+ is under, as a vector."""
    law = ca.vertcat(*run.laws[-1])
    for limit, inner in reversed(list(zip(run.limits, run.laws, strict=False))):
        law = ca.if_else(x < limit if run.rising else x > limit, ca.vertcat(*inner), law)
    return law


def polarization(m: Material, x: Any, field: Any) -> Any:
    """P [C/m^2] (3.20)."""
    return field / m.reciprocal_permittivity + (2.0 * x - 1.0) * m.domain_polarization
