"""The order of test files: those that take longest come first, or one worker would be busy alone in the end."""

from __future__ import annotations

import pytest

LONGEST = (
    "test_diagnosis.py",
    "test_lattice_pasts.py",
    "test_rate_independent_base.py",
    "test_formula.py",
    "test_unknown_past.py",
    "test_shaped.py",
    "test_packages.py",
    "test_shortcuts.py",
    "test_time_limit.py",
    "test_undeclared.py",
    "test_of_kinds.py",
    "test_elements_beside.py",
    "test_fatigue_zero.py",
    "test_reach_of_pasts.py",
    "test_court.py",
    "test_poled_beside_effects.py",
    "test_relays_with_pasts.py",
    "test_scale_of_polarization.py",
    "test_figures.py",
)
"""In tests/unit, as CI says; other folders stay before that, for they compile what these need."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort them within their folders."""
    folders = list(dict.fromkeys(item.path.parent for item in items))
    places = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: (folders.index(item.path.parent), places.get(item.path.name, len(LONGEST))))
