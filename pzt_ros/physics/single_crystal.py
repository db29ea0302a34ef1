"""A perfect single crystal: one kind of domain, two orientations (thesis 3.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from pzt_ros.errors import BenchError
from pzt_ros.physics import polycrystal_kernel as kernel
from pzt_ros.physics.kinetics import thermal_width
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import BOLTZMANN, choice, parameter

_SQRT_PI = math.sqrt(math.pi)


@dataclass(frozen=True, kw_only=True)
class SingleCrystal:
    """Energies, domain averages, kinetics and loops of one kind of domain.

    Attributes:
        averages: "exact" (3.3, 3.4), or "minimum": each well's minimum P_T + E/E_1, as in the thesis' programs (3.20).
            They differ where thermal activation reaches the barrier: large kT/V_D, or a field near -E_c for P+.
        prefactor: "unity", as in the programs, so that published relaxation times mean the same; "exact": 2a/sqrt(pi)
            with a = sqrt(E_1 V_D/(2 k T)), as (3.9, 3.10) have it.
    """

    coercive_field: float = parameter(0.5e6, "V/m", "E_1 (P_T - P_I)", symbol="E_c", bounds=(0.0, 1e8))
    relaxation_time: float = parameter(
        1e-3, "s", "of thermally activated switching", symbol="tau_x", bounds=(1e-12, 1e6)
    )
    domain_polarization: float = parameter(0.26, "C/m^2", "of a domain at zero field", symbol="P_T", bounds=(0.0, 2.0))
    reciprocal_permittivity: float = parameter(6e7, "V m/C", "dE/dP of a domain", symbol="E_1", bounds=(1e5, 1e10))
    temperature: float = parameter(293.0, "K", "of the crystal", symbol="T", bounds=(1.0, 1000.0))
    domain_volume: float = parameter(1e-22, "m^3", "that switches at once", symbol="V_D", bounds=(1e-27, 1e-18))
    averages: str = choice(
        "minimum", ("minimum", "exact"), "polarization of a domain: at the well's minimum, or averaged"
    )
    prefactor: str = choice("unity", ("unity", "exact"), "factor 2a/sqrt(pi) of the transition rates")

    @property
    def barrier_polarization(self) -> float:
        """P_I = P_T - E_c/E_1, where the wells meet the barrier [C/m^2]."""
        return self.domain_polarization - self.coercive_field / self.reciprocal_permittivity

    @property
    def thermal_width(self) -> float:
        """d [V/m]."""
        return thermal_width(self.reciprocal_permittivity, self.temperature, self.domain_volume)

    @property
    def rate_factor(self) -> float:
        """1/tau, times 2a/sqrt(pi) if that is wanted [1/s; a in m^2/C, as the thesis writes it]."""
        if self.prefactor == "unity":
            return 1.0 / self.relaxation_time
        stiffness = self.reciprocal_permittivity * self.domain_volume / (2 * BOLTZMANN * self.temperature)
        return 2 * math.sqrt(stiffness) / _SQRT_PI / self.relaxation_time

    def helmholtz_energy(self, polarization: Array) -> Array:
        """psi [J/m^3] over P [C/m^2]: two parabolas joined smoothly between -P_I and P_I (3.1).

        Raises:
            BenchError: a coercive field so large that P_I would not be above 0: the wells no longer meet.
        """
        p_i, p_t, e_1 = self.barrier_polarization, self.domain_polarization, self.reciprocal_permittivity
        if p_i <= 0:
            raise BenchError(
                f"single crystal: coercive field {self.coercive_field:.6g} V/m leaves no barrier; keep it below"
                f" E_1 P_T = {e_1 * p_t:.6g} V/m"
            )
        p = np.asarray(polarization, dtype=float)
        well = 0.5 * e_1 * (np.abs(p) - p_t) ** 2
        barrier = 0.5 * e_1 * (p_i - p_t) * (p**2 / p_i - p_t)
        return np.where(np.abs(p) >= p_i, well, barrier)

    def gibbs_energy(self, polarization: Array, electric_field: Array | float) -> Array:
        """G = psi - E P [J/m^3] over P [C/m^2] at a field E [V/m]."""
        return self.helmholtz_energy(polarization) - electric_field * np.asarray(polarization, dtype=float)

    def mean_polarization_up(self, electric_field: Array) -> Array:
        """<P+> [C/m^2] at fields E [V/m] (3.3), or the minimum of that well.

        In the well the Boltzmann density is a Gaussian around P_T + E/E_1, truncated at P_I; its mean lies above by the
        deviation times the inverse Mills ratio, sqrt(2/pi)/erfcx(distance/sqrt(2)).
        """
        field = np.asarray(electric_field, dtype=float)
        centre = self.domain_polarization + field / self.reciprocal_permittivity
        if self.averages == "minimum":
            return centre
        inside = -(self.coercive_field + field) / self.thermal_width
        deviation = self.thermal_width / self.reciprocal_permittivity  # sqrt(2) standard deviations
        return centre + deviation / (_SQRT_PI * special.erfcx(np.maximum(inside, -26.0)))

    def mean_polarization_down(self, electric_field: Array) -> Array:
        """<P-> [C/m^2] at fields E [V/m] (3.4), or the minimum of that well."""
        return -self.mean_polarization_up(-np.asarray(electric_field, dtype=float))

    def rate_up(self, electric_field: Array) -> Array:
        """p(-→+) [1/s] at fields E [V/m] (3.10)."""
        distance = (np.asarray(electric_field, dtype=float) - self.coercive_field) / self.thermal_width
        return self.rate_factor / special.erfcx(np.maximum(distance, -26.0)) * (distance > -26.0)

    def rate_down(self, electric_field: Array) -> Array:
        """p(+→-) [1/s] at fields E [V/m] (3.9)."""
        return self.rate_up(-np.asarray(electric_field, dtype=float))

    def polarization(self, electric_field: Array, phase_fraction: Array) -> Array:
        """P [C/m^2] from field E [V/m] and x+ [-] (3.5)."""
        up, down = self.mean_polarization_up(electric_field), self.mean_polarization_down(electric_field)
        return phase_fraction * up + (1 - phase_fraction) * down

    def simulate(
        self, time: Array, electric_field: Array, phase_fraction: float = 0.0, accuracy: float = 1e-8
    ) -> tuple[Array, Array]:
        """P [C/m^2] and x+ [-] under a field history that is linear between its samples (3.8, figure 3.2).

        Args:
            time: of the samples [s], increasing, shape (n,).
            electric_field: at the samples [V/m], shape (n,).
            phase_fraction: x+ at the first sample [-].
            accuracy: largest error of the integration in x+ [-].

        Raises:
            BenchError: times that do not increase, values that are not finite, no sample, a fraction outside 0 to 1.
        """
        time, field = np.asarray(time, dtype=float), np.asarray(electric_field, dtype=float)
        if time.size == 0 or time.shape != field.shape:
            raise BenchError(f"single crystal: {time.size} times and {field.size} fields; give one field per time")
        if not 0 <= phase_fraction <= 1:
            raise BenchError(f"single crystal: phase fraction {phase_fraction:.6g} at the start is outside 0 to 1")
        barrier = np.array([self.coercive_field / self.thermal_width])
        domain = kernel.Elements(
            forward=barrier,
            backward=-barrier,
            row_weight=np.ones(1),
            column_weight=np.ones(1),
            width=self.thermal_width,
            attempt_rate=self.rate_factor,
            susceptibility=0.0,
            domain_polarization=0.0,
            bias=0.0,
            layer_thickness=1.0,
            method=kernel.COLLOCATION,
            field_step=kernel.field_step(kernel.COLLOCATION, accuracy),
        )
        state = np.array([time[0], field[0], 0.0, phase_fraction])
        fractions = np.empty(time.size)
        bad = kernel.run(state, domain, time, field, np.empty(time.size), fractions)
        if bad >= 0:
            raise BenchError(f"single crystal: sample {bad} is not finite or not after the one before; drop or sort it")
        return self.polarization(field, fractions), fractions
