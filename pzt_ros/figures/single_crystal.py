"""Figure 3.2: energies and the loop of a perfect single crystal."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from pzt_ros.figures.canvas import FAST, INK, MUTED, POLARIZATION, SHADE, SLOW, curve, sheet
from pzt_ros.figures.thesis_figure import Drawing, Finding, below
from pzt_ros.physics.signals import Array
from pzt_ros.physics.single_crystal import SingleCrystal

# Wells so soft that an eye can see them; the thesis' figure is a sketch too.
_CRYSTAL = SingleCrystal(coercive_field=0.8e6, domain_polarization=0.26, reciprocal_permittivity=6e6, averages="exact")
_RATE = 1e6  # [V/m/s]: slow against tau of 1 ms
_SHARES = (0.0, 0.5, 1.0, 1.25)  # of the coercive field


def energies(samples: int) -> Drawing:
    """Figure 3.2."""
    crystal = _CRYSTAL
    amplitude = 1.6 * crystal.coercive_field
    up = np.linspace(-amplitude, amplitude, 4 * samples)
    field = np.concatenate([up, up[-2::-1]])
    time = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(field)) / _RATE)))
    polarization, fraction = crystal.simulate(time, field)
    rising = slice(0, 4 * samples)
    figure = sheet(11.4, 5.6, "single crystal, parameters chosen to be seen")
    axes = figure.subplots(2, len(_SHARES), sharey="row")
    for column, share in zip(axes.T, _SHARES, strict=True):
        here = share * crystal.coercive_field
        k = int(np.searchsorted(field[rising], here))
        _energy(column[0], crystal, here, float(polarization[k]))
        curve(column[1], field / 1e6, polarization, SHADE)
        curve(column[1], field[: k + 1] / 1e6, polarization[: k + 1], SLOW, linewidth=2.0)
        column[1].plot(field[k] / 1e6, polarization[k], "o", color=FAST, ms=7)
        column[1].set_xlabel("field [kV/mm]")
    axes[0, 0].set_ylabel("(a) energy [kJ/m³]")
    axes[1, 0].set_ylabel(f"(b) {POLARIZATION}")
    axes[0, 0].legend(loc="upper center", ncols=2)
    axes[0, 0].set_ylim(-420, 290)
    return Drawing(figure, _findings(crystal, field, polarization, fraction, rising), _NOTE)


_NOTE = (
    f"P_T {_CRYSTAL.domain_polarization:g} C/m², E_1 {_CRYSTAL.reciprocal_permittivity:g} V m/C, E_c"
    f" {_CRYSTAL.coercive_field / 1e6:g} kV/mm, V_D {_CRYSTAL.domain_volume:g} m³, τ"
    f" {1e3 * _CRYSTAL.relaxation_time:g} ms, {_RATE / 1e6:g} kV/mm/s; the dot is the crystal's state."
)


def _energy(axis: Axes, crystal: SingleCrystal, field: float, state: float) -> None:
    p = np.linspace(-0.52, 0.56, 400)
    curve(axis, p, crystal.helmholtz_energy(p) / 1e3, MUTED, "ψ", linestyle=(0, (3, 2)), linewidth=1.0)
    curve(axis, p, crystal.gibbs_energy(p, field) / 1e3, INK, "G", linewidth=1.6)
    axis.plot(state, crystal.gibbs_energy(np.array([state]), field) / 1e3, "o", color=FAST, ms=7)
    axis.set(xlabel="polarization [C/m²]")
    axis.set_title(f"E = {field / 1e6:.2g} kV/mm" + (" = $E_c$" if field == crystal.coercive_field else ""))


def _findings(
    crystal: SingleCrystal, field: Array, polarization: Array, fraction: Array, rising: slice
) -> tuple[Finding, ...]:
    minima = [_minima(crystal, share * crystal.coercive_field) for share in _SHARES]
    switch = float(np.interp(0.5, fraction[rising], field[rising]))
    saturated = (field > 1.2 * crystal.coercive_field) & (fraction > 0.999)
    slope = np.polyfit(field[saturated], polarization[saturated], 1)[0]
    product = float(slope * crystal.reciprocal_permittivity)
    remnant = float(np.interp(0.0, -field[rising.stop :], polarization[rising.stop :]))
    return (
        Finding(
            "as the field rises one well of G flattens and vanishes at E_c",
            f"wells at 0, 0.5, 1 and 1.25 E_c: {', '.join(map(str, minima))}",
            minima == [2, 2, 1, 1],
        ),
        below(
            "then the crystal switches",
            f"half of it by {switch / 1e6:.3f} kV/mm, off E_c by",
            100 * abs(switch / crystal.coercive_field - 1),
            10.0,
        ),
        Finding(
            "1/E_1 is the slope of P over E, P_T the remnant polarization",
            f"slope of the upper branch times E_1 {product:.4f}, polarization on the way down at field 0 {remnant:.4f},"
            f" P_T = {crystal.domain_polarization:g} C/m²; taken as agreeing within 1 %",
            bool(abs(product - 1) < 0.01 and abs(remnant / crystal.domain_polarization - 1) < 0.01),
        ),
    )


def _minima(crystal: SingleCrystal, field: float) -> int:
    """How many wells the Gibbs energy has; one that is level with its barrier within rounding is none."""
    p = np.linspace(-0.6, 0.6, 4801)
    energy = crystal.gibbs_energy(p, field)
    wells = 1 + np.flatnonzero((np.diff(energy[:-1]) < 0) & (np.diff(energy[1:]) > 0))
    between = energy[np.searchsorted(p, -crystal.barrier_polarization)]
    barrier = max(float(between), float(energy[np.searchsorted(p, crystal.barrier_polarization)]))
    return int(sum(barrier - energy[k] > 1e-3 * np.ptp(energy) for k in wells))
