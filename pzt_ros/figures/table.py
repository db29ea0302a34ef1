"""Every figure of the thesis that is drawn: one line each."""

# ruff: noqa: E501 - one line each

from __future__ import annotations

from pzt_ros.figures import (
    domains,
    fits,
    full_loops,
    minor_loops,
    optimal_cases,
    optimal_control,
    parametrized,
    polycrystal,
    relaxation,
    single_crystal,
)
from pzt_ros.figures.thesis_figure import ThesisFigure as Fig

FIGURES: tuple[Fig, ...] = (
    Fig("2.4", "Full loop, half-sine, 0.1 Hz", "All that is recorded of a full loop. |P| and S are slightly smaller at -1.5 than at +1.5 kV/mm, since the stack was poled upwards; strain over polarization (b) is a loop and no parabola; the current (g) peaks at about 0.6 mA, where the polarization changes fastest; over the hold (h) P and S hardly grow.", full_loops.full_half_sine),
    Fig("2.5", "Full loop, linear, 0.1 kV/mm/s", "The same with straight lines of the field. The curves are very similar to those of the half-sine.", full_loops.full_linear),
    Fig("2.6", "Full loops at two rates", "Whatever the form of the drive, loops are wider at the higher rate: a higher coercive field. The faster loops have a smaller polarization and strain at -1.5 kV/mm, since fewer domains have time to switch.", full_loops.rates),
    Fig("2.7", "Actuator loop, half-sine, 0.1 Hz", "The largest loop in the actuator range, 1.5 to -0.4 kV/mm: like the profile of a wing. The descending branch is part of the full outer loop; on the way up most switches at about 0.4 kV/mm. The loop of strain over polarization is less obvious than in the full range, but still visible.", full_loops.actuator_half_sine),
    Fig("2.8", "Actuator loop, linear, 0.1 kV/mm/s", "Very similar to the half-sine, but the current is so low that it is almost buried in the background noise.", full_loops.actuator_linear),
    Fig("2.9", "Minor loops type 1: polarization", "Down to a reversal point and back to 1.5 kV/mm. The largest loop comes down to 0.12 C/m² at 0.1 Hz, at 100 Hz only to 0.16. Upwards the fastest transformation is almost always at 0.4 kV/mm; the higher the reversal point, the straighter the way up. Hardly any relaxation at 1.5 kV/mm.", minor_loops.polarization_of("type1")),
    Fig("2.10", "Minor loops type 1: strain", "The strain of the same experiments: 0.02 % at the lowest point at 0.1 Hz, 0.035 % at 100 Hz.", minor_loops.strain_of("type1")),
    Fig("2.11", "Minor loops type 2: polarization", "Down to -0.4 kV/mm, up to a reversal point, back to -0.4 kV/mm. The descending loops are very similar in shape. At the end there is a noticeable drop even at the lowest rates; slow drives start it lower, fast ones higher, and all relax to almost the same level.", minor_loops.polarization_of("type2")),
    Fig("2.12", "Minor loops type 2: strain", "The strain of the same experiments, with the same observations.", minor_loops.strain_of("type2")),
    Fig("2.13", "Minor loops type 3: polarization", "Down to a reversal point, a loop of 0.5 kV/mm upwards, hold. The minor loops have the shape of a weaving shuttle, narrower at higher fields. The relaxation is larger at lower reversals, at -0.4 kV/mm above all, and larger after a faster cycle; at one reversal point it always ends at the same level.", minor_loops.polarization_of("type3")),
    Fig("2.14", "Minor loops type 3: strain", "The strain of the same experiments, with the same observations.", minor_loops.strain_of("type3")),
    Fig("2.15", "Minor loops type 4: polarization", "Down to -0.4 kV/mm, up to a reversal point, a loop of 0.5 kV/mm downwards, hold. Shuttles again, narrower at higher fields; relaxation is not prominent on these ascending loops, the increase over the hold is hardly noticeable.", minor_loops.polarization_of("type4")),
    Fig("2.16", "Minor loops type 4: strain", "The strain of the same experiments, with the same observations.", minor_loops.strain_of("type4")),
    Fig("2.17", "Relaxation over time", "Strain at a constant -0.2 kV/mm, after slow and fast drives. The faster one starts from a higher strain; then the strain drops asymptotically towards an equilibrium and overlaps with that of the slower one.", relaxation.over_time),
    Fig("3.2", "Energies and loop of a single crystal", "Helmholtz energy ψ and Gibbs energy G = ψ - EP for an increasing field (a), and the loop of polarization over field (b). One well vanishes as the field rises, then the crystal switches. P_T is the remnant polarization, 1/E_1 the slope of P over E.", single_crystal.energies),
    Fig("3.6", "Polarization by the quadrature method", "A representative simulation at 10 kV/mm/s. It shows that the model gives symmetric minor loops without bias, biased asymmetric ones, and loops that close.", polycrystal.representative),
    Fig("3.7", "Nine combinations of distributions", "b₁ grows from left to right, b₂ from top to bottom. Both make the major loop gradual, but differ in the minor loops: with a narrow E_e (top row) very little switches before the field passes zero; with a narrow E_c (left column) minor loops almost never switch before they reach the major loop.", polycrystal.nine),
    Fig("3.10", "Coercive fields only: parametrized and quadrature", "Left the parametrized version with (3.23), right the quadrature with 32 elements. Both produce almost the same loops; the quadrature is less smooth. Behind a reversal the barrier starts from zero, so reversal points have to be tracked.", parametrized.coercive_fields),
    Fig("3.13", "Interaction fields only: parametrized and quadrature", "Left the parametrized version with (3.31), right the quadrature with 32 elements, noticeably jagged. The barriers depend on x+ alone: no reversal points need to be stored, special minor loops do not exist.", parametrized.interaction_fields),
    Fig("3.18", "A simple minor loop", "From (1), x+ = 0 and an effective barrier of -2 kV/mm, to (2) at field zero and back through (3) at -1 kV/mm, with the full major loop.", domains.minor_loop),
    Fig("3.19", "Domain states at point (1)", "The distribution of domains over coercive and interaction field: left those that are up, right those that are down. All are down.", domains.at_point(1)),
    Fig("3.20", "Domain states at point (2)", "On the way from (1) to (2) a vertical plane B_e = E_c - E_e has scanned the distribution; the volumes are x+ and x-.", domains.at_point(2)),
    Fig("3.21", "Domain states at point (3)", "On the way back the plane is perpendicular to the first one, since E_c counts as negative in it.", domains.at_point(3)),
    Fig("3.22", "Major loop and a family of minor loops", "With both distributions, by quadrature. The major loop still resembles an inverse complementary error function, and the minor loops have very similar shapes: the reason for using one function for all, scaled between reversal points (3.34, 3.35).", polycrystal.family),
    Fig("3.23", "Both distributions: parametrized and quadrature", "Left the parametrized version (s = 1.3, B_e = 0.5 kV/mm), right the quadrature of figure 3.6: the same type of hysteresis, and return-point memory of the barrier in any case.", parametrized.combined),
    Fig("3.24", "Full loop: fit to the experiment", "Polarization and strain of the model over the slow linear full loop. It captures the characteristics qualitatively but is no perfect match, strain in particular: the shape function need not be that of the material, and S = ζP² has no hysteresis.", fits.full_loop),
    Fig("3.25", "Type 1: experiment and simulation", "Strain over field at the lowest rate, model with its own shapes up and down. In the actuator range the curves match much better than in the full range; the trends of the minor loops are reflected.", fits.minor_loops("type1")),
    Fig("3.26", "Type 2: experiment and simulation", "The same for type 2.", fits.minor_loops("type2")),
    Fig("3.27", "Type 3: experiment and simulation", "The same for type 3; the simulated small minor loops are narrower than the measured ones, descending loops above all.", fits.minor_loops("type3")),
    Fig("3.28", "Type 4: experiment and simulation", "The same for type 4; the simulated small minor loops are narrower than the measured ones.", fits.minor_loops("type4")),
    Fig("3.29", "Relaxation: experiment", "Strain over field, and strain over the 10 s of the hold at -0.2 kV/mm, after a slow and a fast linear drive. It relaxes slowly and asymptotically, from different levels to the same one.", relaxation.measured),
    Fig("3.30", "Relaxation: parametrized model", "The same drives. The dependence on rate is there, but the drop takes place almost immediately at the beginning of the hold, as in a perfect crystal with one barrier.", relaxation.parametrized),
    Fig("3.31", "Relaxation: quadrature model", "The same drives, V_D and τ. The values are not directly comparable with the experiment, but the relaxation is gradual as there, and ends at one level.", relaxation.quadrature),
    Fig("4.1", "The model of chapter 4 at two frequencies", "The simplified model for optimal control at 0.125 and 125 Hz: coercive fields only, no history. Note the dramatic effect of the frequency on the shape of outer and inner loops.", optimal_control.two_frequencies),
    Fig("4.2", "Optimal control, case 1: over time", "The field starts with a sharp increase, goes on about ten times slower to a peak of 3.3 MV/m, where the polarization has almost reached the set point, and then decreases asymptotically to about 1.9 MV/m, while domains go on switching.", optimal_cases.case_1_over_time),
    Fig("4.3", "Optimal control, case 1: polarization over field", "The actuator first follows the widest loop, then one of a lower frequency, and finally relaxes to a point on the quasistatic outer loop (0.125 Hz).", optimal_cases.case_1_over_loops),
    Fig("4.4", "Optimal control, case 2: over time", "Set points of 0.1, 0.2 and again 0.1 C/m²: a positive field for the first, a negative one for the last, because of the history; the largest field is almost that of case 1.", optimal_cases.case_2_over_time),
    Fig("4.5", "Optimal control, case 2: polarization over field", "In following the three set points the actuator first follows a loop of a higher frequency, but always comes back to a point on a loop of low frequency.", optimal_cases.case_2_over_loops),
)  # fmt: skip
"""In the order of the thesis."""
