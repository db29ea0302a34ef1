"""Generated pages are up to date, and the README's commands and files exist."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[2]


def generator(name: str) -> ModuleType:
    """A script of docs/, which is no package."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_topics_page_is_the_topic_table() -> None:
    assert (ROOT / "docs" / "topics.md").read_text(encoding="utf-8") == generator("make_topics").text()


def test_the_page_of_all_samples_is_what_the_results_say() -> None:
    made = generator("make_court")
    assert (ROOT / "docs" / "court-samples.md").read_text(encoding="utf-8") == made.page()
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert made.BEGIN + made.readme_part() + made.END in readme
    assert sum(len(path.read_text(encoding="utf-8").splitlines()) for path in made.samples()) > 400


def test_links_of_the_pages_lead_somewhere() -> None:
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))):
        for target in re.findall(r"\]\((?!https?:|#)([^)#]+)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"
