"""Every page of the gallery can be done as it stands, and what comes out is what it says."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import psutil
import pytest
from graph_process import alive, wait_until
from matplotlib.image import imread

from pzt_benchmarks import gallery
from pzt_ros.errors import BenchError

SAYS = {
    "01-loops": "",
    "02-characterise": "",
    "03-fit": "x noise floor",
    "04-diagnose": "Missing: slow relaxation",
    "05-optimal": "peak field 3.32",
    "06-track": "times better than open_loop",
    "07-controller": "secant: 1",
    "08-effect": "Missing: fringe error",
    "09-node": '"there_m": 2.',
    "10-axes": "x: run complete; y: run complete",
    "11-driver": "least step of the reading: 50 nm",
}
"""Words that the commands of each page say."""

LONG = "02-characterise", "03-fit", "04-diagnose", "06-track", "08-effect", "09-node", "10-axes", "11-driver"


def test_every_page_is_tried() -> None:
    assert list(SAYS) == gallery.pages()


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in SAYS])
def test_a_page_can_be_done_as_it_stands(name: str, tmp_path: Path) -> None:
    gallery.build([name], tmp_path, lambda _: None)
    page = (tmp_path / f"{name}.md").read_text(encoding="utf-8")
    assert SAYS[name] in "".join(re.findall(r"^```text\n(.*?)^```", page, re.MULTILINE | re.DOTALL))
    pictures = list((tmp_path / "images").iterdir())
    assert pictures
    for picture in pictures:
        shades = imread(picture)
        assert np.mean(np.any(shades != shades[0, 0], axis=-1)) > 0.005, f"{picture.name} shows nothing"


def test_the_index_has_all_pages() -> None:
    assert (gallery.PAGES / "README.md").read_text(encoding="utf-8") == gallery.index(gallery.PAGES)


def test_a_page_that_cannot_be_done_says_what_failed(tmp_path: Path) -> None:
    with pytest.raises(BenchError, match=r"exit code 3 of: echo hello; exit 3\nhello"):
        gallery.perform("```sh\necho hello; exit 3\n```\n", tmp_path)
    with pytest.raises(BenchError, match=r"no command of the page made gone\.png"):
        gallery.perform("![A picture](images/gone.png)\n", tmp_path)


def test_blocks_become_files_and_outputs_the_page(tmp_path: Path) -> None:
    page = "```python said.py\nprint(6 * 7)\n```\n\n```sh\npython said.py\n```\n\n```text\nold\n```\n"
    assert gallery.perform(page, tmp_path) == page.replace("old", "42")


def test_what_takes_too_long_is_ended_with_all_that_it_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gallery, "PATIENCE", 1.0)
    with pytest.raises(BenchError, match="not done after 1 s"):
        gallery.perform("```sh\nsleep 600 & echo $! > child\nwait\n```\n", tmp_path)
    child = int((tmp_path / "child").read_text(encoding="utf-8"))
    wait_until(lambda: _has_ended(child), "the end of the child")


def _has_ended(number: int) -> bool:
    try:
        return not alive([psutil.Process(number)])
    except psutil.NoSuchProcess:
        return True
