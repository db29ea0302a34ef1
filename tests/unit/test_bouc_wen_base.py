"""The base of elements that slip: stages that no density of relays describes, and what is named on them."""

from __future__ import annotations

from pathlib import Path

import pytest

from pzt_benchmarks.residual_court.cases import Spec, make_case
from pzt_benchmarks.residual_court.files import write_case
from pzt_ros.chains import load_chain
from pzt_ros.diagnosis.diagnose import diagnose
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.physics.bouc_wen import BoucWen
from pzt_ros.records import read_csv

NULL = Spec("null_wrong", "bouc_wen", protocol="short", seed=5)
HUM = Spec("effect_wrong", "maxwell_slip", ("mains_hum",), 5.0, "short", seed=6)


@pytest.mark.parametrize(("spec", "names"), [(NULL, []), (HUM, ["mains_hum"])], ids=["nothing hidden", "hum"])
def test_elements_that_slip_come_down_to_the_noise(spec: Spec, names: list[str], tmp_path: Path) -> None:
    files = write_case(make_case(spec), tmp_path)
    assert files.declared is not None
    train, test = ([read_csv(path) for path in paths] for paths in (files.train, files.test))
    report = diagnose(train, test, load_chain(files.declared), workers=IN_THIS_PROCESS)
    assert [effect.name for effect in report.effects] == names
    assert report.base == {"model": BoucWen.kind, "density": "none"}
    assert not report.remains.present
    assert report.after.score < 1.1 * report.noise
    report.save_data(tmp_path)
    assert BoucWen in [type(link) for link in load_chain(tmp_path / "model.yaml").links]
