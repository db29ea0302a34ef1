"""What is shipped: a wheel that works outside the checkout, and manifests that say the same as the code."""

from __future__ import annotations

import ast
import importlib
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PACKAGE = ElementTree.parse(ROOT / "package.xml").getroot()
SCRIPTS = {e.name: e.value for e in metadata.entry_points(group="console_scripts") if e.name.startswith("pzt")}
BUILT_FROM = ("pzt_ros", "nodes", "msgs_config", "bringup", "benchmarks", "resource")
FILES = ("pyproject.toml", "setup.py", "setup.cfg", "package.xml", "README.md", "LICENSE")

SHORT = """
scenario: short
plant: bench-stage
model: thesis-p2
phases:
  - {phase: voltage, to: 20 V, duration: 0.2 s}
  - {phase: voltage, to: 0 V, duration: 0.2 s}
"""


def requirements() -> list[str]:
    """What pzt_ros needs at run time, without extras."""
    return [line for line in metadata.requires("pzt_ros") or [] if "extra ==" not in line]


def name_of(requirement: str) -> str:
    return re.split(r"[<>=!~ ;\[]", requirement)[0].lower()


# -- manifests


def test_one_version_everywhere() -> None:
    version = metadata.version("pzt_ros")
    assert PACKAGE.findtext("version") == version
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))["version"] == version


def test_the_manifest_names_the_ros_packages_that_are_imported() -> None:
    imported = set()
    for path in (ROOT / "nodes").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                imported.add((node.module or "").split(".")[0])
    ros = {name for name in imported if name == "rclpy" or name.endswith(("_msgs", "_srvs", "_interfaces"))}
    assert {entry.text for entry in PACKAGE.findall("exec_depend")} == ros | {"rmw_fastrtps_cpp"}


def test_every_program_can_be_imported() -> None:
    assert {"pzt", *(f"pzt_{node}_node" for node in ("amplifier", "plant", "sensor", "experiment"))} <= set(SCRIPTS)
    for target in SCRIPTS.values():
        module, _, function = target.partition(":")
        assert callable(getattr(importlib.import_module(module), function))


def test_the_jazzy_page_installs_what_is_needed() -> None:
    page = (ROOT / "docs" / "jazzy.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^pip install 'setuptools.*$", page, flags=re.MULTILINE)
    named = {name_of(word.strip("'")) for word in line.split()[2:]} - {"setuptools"}
    assert named == {name_of(line) for line in requirements() if not line.startswith("ros-")}


def test_the_citation_has_what_the_format_asks_for() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(cited)
    assert cited["license"] == PACKAGE.findtext("license")


# -- the wheel


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy of the checkout, as pip does."""
    folder = tmp_path_factory.mktemp("wheel")
    for name in BUILT_FROM:
        shutil.copytree(ROOT / name, folder / "src" / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in FILES:
        shutil.copy(ROOT / name, folder / "src" / name)
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--quiet", "-w", str(folder), str(folder / "src")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "No matching distribution found for setuptools" in done.stderr:
        pytest.skip("no package index here to bring the build's own setuptools")
    assert done.returncode == 0, done.stderr
    (built,) = folder.glob("pzt_ros-*.whl")
    return built


@pytest.fixture(scope="module")
def elsewhere(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A venv with the wheel; what it depends on is taken from ours."""
    venv = tmp_path_factory.mktemp("elsewhere") / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(venv)], check=True)
    python = venv / "bin" / "python"
    site = Path(sysconfig.get_path("purelib", vars={"base": str(venv), "platbase": str(venv)}))
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--no-deps", "--quiet", str(wheel)]
    subprocess.run(pip, check=True, stderr=subprocess.DEVNULL)
    ours = sysconfig.get_path("purelib")
    (site / "ours.pth").write_text(f"import site; site.addsitedir({ours!r})\n", encoding="utf-8")
    return venv


def run(venv: Path, folder: Path, *words: str) -> str:
    """`pzt` of that venv, started in a folder that is not the checkout."""
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")}
    done = subprocess.run(
        [str(venv / "bin" / "pzt"), *words], cwd=folder, env=clean, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_wheel_holds_the_data_files(wheel: Path) -> None:
    held = set(ZipFile(wheel).namelist())
    for folder, name in (("pzt_ros", "pzt_ros"), ("msgs_config", "pzt_config")):
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and path.suffix not in (".pyc", ".nbi", ".nbc"):
                assert f"{name}/{path.relative_to(ROOT / folder)}" in held
    assert any(name.endswith("share/ament_index/resource_index/packages/pzt_ros") for name in held)
    assert any(name.endswith("share/pzt_ros/package.xml") for name in held)


def test_the_wheel_works_outside_the_checkout(elsewhere: Path, tmp_path: Path) -> None:
    python = elsewhere / "bin" / "python"
    where = "import pzt_ros, pzt_nodes, pzt_bringup; print(pzt_ros.__file__, pzt_nodes.__file__, pzt_bringup.__file__)"
    found = subprocess.run([str(python), "-c", where], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert all(Path(path).is_relative_to(elsewhere) for path in found.split())
    assert "panel" in run(elsewhere, tmp_path, "--help")
    assert "thesis-p2" in run(elsewhere, tmp_path, "chains")
    (tmp_path / "short.yaml").write_text(SHORT, encoding="utf-8")
    run(elsewhere, tmp_path, "run", "short.yaml", "--out", "run")
    assert (tmp_path / "run" / "report.html").is_file()
    assert "/stage/measurement" in run(elsewhere, tmp_path, "bag", "info", "run/bag", "--json")
