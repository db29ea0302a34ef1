"""Chains as YAML: the table of links, shipped chains by name, reading and writing."""

from __future__ import annotations

import functools
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from pzt_ros.effects.table import EFFECTS
from pzt_ros.errors import BenchError
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.bouc_wen import BoucWen
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.front import Front
from pzt_ros.physics.identified_lattice import IdentifiedLattice
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.link import SECTIONS, Link
from pzt_ros.physics.parametrized import Parametrized
from pzt_ros.physics.parametrized_single import ParametrizedSingle
from pzt_ros.physics.preisach import Preisach
from pzt_ros.physics.quadrature import Quadrature
from pzt_ros.physics.sensor import DisplacementSensor
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_hysteresis import StrainHysteresis
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.physics.structure import Structure
from pzt_ros.quantities import build, choices_of, forms_of, parameters_of, table_to_data, tables_of, to_text

_ALWAYS: tuple[type[Link], ...] = (
    Amplifier, Parametrized, ParametrizedSingle, Quadrature, Lattice, Front, IdentifiedLattice, Preisach,
    BoucWen, Electrostriction, StrainHysteresis, StrainLaw, Structure, DisplacementSensor,
)  # fmt: skip

LINKS: dict[str, type[Link]] = {link.kind: link for link in (*_ALWAYS, *(effect.link for effect in EFFECTS))}
"""Every link a chain file may name: those of stages as they are described, and the effects they may have beside."""

_NOTES = ("description", "source", "free", "fit", "start")
"""What a chain file may say beside its links.

`free` names the parameters that a fit may move; `fit` and `start` are what one has found (pzt_ros.sysid).
"""


def shipped_chains() -> dict[str, Path]:
    """The chains that come with the package: name -> file."""
    return shipped("chains")


def shipped(folder: str) -> dict[str, Path]:
    """The YAML files of one folder of `msgs_config`: name -> file."""
    found = Path(str(resources.files("pzt_config"))) / folder
    return {path.stem: path for path in sorted(found.glob("*.yaml"))}


def load_chain(name_or_path: str | Path) -> Chain:
    """A chain by shipped name or from a YAML file.

    Raises:
        BenchError: no such chain, bad YAML, unknown link, key or unit, links in an impossible order.
    """
    return parse_chain(*read_yaml(name_or_path, shipped_chains(), "chain"))


def load_model(name_or_path: str | Path) -> Chain:
    """A chain as observers and controllers believe in it: without noise and least steps. Raises as `load_chain`."""
    return load_chain(name_or_path).with_links(lambda link: link.noiseless())


def read_yaml(name_or_path: str | Path, shipped_files: dict[str, Path], what: str) -> tuple[Any, str]:
    """The content of a YAML file, by shipped name or by path, and how to name it in an error.

    Raises:
        BenchError: no such file, or it is not YAML.
    """
    path = shipped_files.get(str(name_or_path), Path(name_or_path))
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8")), path.name
    except FileNotFoundError:
        names = ", ".join(shipped_files)
        raise BenchError(f"{what} '{name_or_path}': no such file; shipped are {names}") from None
    except OSError as error:
        raise BenchError(f"{what} '{name_or_path}' cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise BenchError(f"{what} '{name_or_path}' is not UTF-8 text: {error}") from None
    except (yaml.YAMLError, ValueError) as error:  # ValueError: a date such as 2026-13-01 is no date
        mark = getattr(error, "problem_mark", None)
        line = f" line {mark.line + 1}:" if mark else ""
        problem = " ".join(str(getattr(error, "problem", error)).split())
        raise BenchError(f"{path.name}:{line} not valid YAML ({problem})") from None


def parse_chain(data: Any, where: str) -> Chain:
    """A chain from the content of its YAML file; `where` names it in errors."""
    if not isinstance(data, dict) or not isinstance(data.get("links"), list) or not data["links"]:
        raise BenchError(f"{where}: not a chain; expected 'chain: name' and a list 'links:'")
    for key in data:
        if key not in ("chain", "links", *_NOTES):
            raise BenchError(f"{where}: unknown key {key!r}; known are chain, links, {', '.join(_NOTES)}")
    links = tuple(_link(entry, f"{where}: link {number}") for number, entry in enumerate(data["links"], start=1))
    _check_order(links, where)
    notes = {key: data[key] for key in _NOTES if key in data}
    return Chain(name=str(data.get("chain", where)), links=links, notes=notes)


def _link(entry: Any, where: str) -> Link:
    if not isinstance(entry, dict) or "link" not in entry:
        raise BenchError(f"{where}: expected 'link: kind' and its parameters, found {entry!r}")
    kind = entry["link"]
    if not isinstance(kind, str) or kind not in LINKS:
        raise BenchError(f"{where}: unknown link {kind!r}; known are {', '.join(LINKS)}")
    values = {key: value for key, value in entry.items() if key != "link"}
    return build(LINKS[kind], values, f"{where} ({kind})")


def _check_order(links: tuple[Link, ...], where: str) -> None:
    order = [SECTIONS.index(link.section) for link in links]
    for link, here, after in zip(links, order, order[1:], strict=False):
        if here > after:
            raise BenchError(
                f"{where}: link '{link.kind}' belongs to the {link.section} and stands too early; order is"
                f" {', '.join(SECTIONS)}"
            )


def chain_as_data(chain: Chain) -> dict[str, Any]:
    """The content of the YAML file that describes a chain, every parameter with its unit."""
    return {"chain": chain.name, **chain.notes, "links": [_entry(link) for link in chain.links]}


def _entry(link: Link) -> dict[str, Any]:
    entry: dict[str, Any] = {"link": link.kind}
    for name, declared in parameters_of(link).items():
        entry[name] = to_text(getattr(link, name), declared.unit)
    for name in choices_of(link):
        entry[name] = getattr(link, name)
    for name, row in tables_of(link).items():
        entry[name] = table_to_data(getattr(link, name), row.unit)
    for name, form in forms_of(link).items():
        if getattr(link, name) is not None:
            entry[name] = form.write(getattr(link, name))
    return entry


def save_chain(chain: Chain, path: str | Path) -> None:
    """Write a chain as YAML that `load_chain` reads back to the same numbers."""
    text = yaml.safe_dump(chain_as_data(chain), sort_keys=False, allow_unicode=True, width=120)
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise BenchError(f"chain file '{path}' cannot be written: {error.strerror}") from None


@functools.cache
def chain_summary(name: str) -> str:
    """The one-line description of a shipped chain."""
    data, _ = read_yaml(name, shipped_chains(), "chain")
    return str(data.get("description", "")).strip()
