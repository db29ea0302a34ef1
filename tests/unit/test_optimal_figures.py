"""Figures 4.2 to 4.5: what the thesis says of them holds for ours, and nothing is left out of the picture."""

from __future__ import annotations

from collections.abc import Callable

import matplotlib
import numpy as np
import pytest

from pzt_ros.figures import optimal_cases as cases
from pzt_ros.figures.thesis_figure import Drawing
from pzt_ros.report.style import LIGHT


@pytest.mark.parametrize(
    "draw", [cases.case_1_over_time, cases.case_1_over_loops, cases.case_2_over_time, cases.case_2_over_loops]
)
def test_what_the_thesis_says_holds(draw: Callable[[int], Drawing]) -> None:
    with matplotlib.rc_context(LIGHT.settings()):
        drawing = draw(200)
    assert drawing.findings
    assert all(finding.holds for finding in drawing.findings), [finding.found for finding in drawing.findings]


def test_the_field_is_drawn_as_it_was_found() -> None:
    found = cases.solution("case2")
    with matplotlib.rc_context(LIGHT.settings()):
        field = cases.case_2_over_time(200).figure.axes[3]
    drawn = np.asarray(field.lines[0].get_ydata(), dtype=float)
    np.testing.assert_allclose(drawn, 1e-6 * found.field)
    low, high = field.get_ylim()
    assert low < drawn.min()
    assert high > drawn.max()
