"""Many parameter sets over one run: the same as one after the other, in their order, whatever the threads."""

from __future__ import annotations

import numpy as np
import pytest

from pzt_ros.errors import BenchError
from pzt_ros.physics.front import Front
from pzt_ros.physics.front_sets import step_all
from pzt_ros.physics.signals import Rest, Signals

TIME = np.arange(1, 2001) / 20e3
RUN = Signals(time=TIME, voltage=120.0 * np.sin(40.0 * TIME) * np.linspace(0.3, 1.0, TIME.size))


@pytest.mark.parametrize("threads", [1, 3])
def test_sets_are_single_runs(threads):
    models = [Front(coercive_field=field, relaxation_time=10.0 / field) for field in np.linspace(3e5, 9e5, 17)]
    rest = Rest(voltage=10.0)
    found = list(step_all(models, rest, RUN, threads=threads))
    assert len(found) == len(models)
    for model, out in zip(models, found, strict=True):
        _, alone = model.step(model.init(rest), RUN)
        assert np.array_equal(out.polarization, alone.polarization)
    assert np.ptp([out.polarization[-1] for out in found]) > 0.01


def test_a_bad_run_is_named():
    bad = RUN.replace(voltage=np.full(TIME.size, np.nan))
    with pytest.raises(BenchError, match="sample 0"):
        list(step_all([Front(), Front()], Rest(), bad, threads=2))
