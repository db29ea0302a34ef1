"""`python -m pzt_benchmarks.gallery`: do what the pages of docs/gallery say, and put what comes out on them.

A page is Markdown. A fenced block with a file name after its language becomes that file, a block `sh` is run, a block
`text` after it is what it said, and a picture of the page has to be there when all is done.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from pzt_benchmarks.report import provenance
from pzt_ros.errors import BenchError

PAGES = Path(__file__).parents[1] / "docs" / "gallery"
"""Where the pages are, in a checkout."""

PATIENCE = 300.0
"""No block of commands takes longer [s]."""

_INDEX = "README.md"
_BLOCK = re.compile(r"^```(?P<kind>\w+)(?: +(?P<file>\S+))?\n(?P<body>.*?)^```\n", re.MULTILINE | re.DOTALL)
_PICTURE = re.compile(r"!\[[^\]]*\]\(images/([^)]+)\)")
_MADE = "<!-- what follows is written by make gallery -->\n"
_CONTROL = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|\r")  # of terminals


def perform(page: str, folder: Path) -> str:
    """Do what a page says in a folder; returns the page with what its commands said.

    Raises:
        BenchError: a command failed, or a picture of the page was not made.
    """
    said = ""

    def done(block: re.Match[str]) -> str:
        nonlocal said
        kind, file, body = block["kind"], block["file"], block["body"]
        if file:
            (folder / file).write_text(body, encoding="utf-8")
        elif kind == "sh":
            said = _run(body, folder)
        elif kind == "text":
            return f"```text\n{said}```\n"
        return block[0]

    found = _BLOCK.sub(done, page)
    missing = [name for name in _PICTURE.findall(page) if not (folder / name).exists()]
    if missing:
        raise BenchError(f"no command of the page made {', '.join(missing)}")
    return found


def _run(commands: str, folder: Path) -> str:
    """What the commands said; they find `pzt` and Python as in an activated environment."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    plain = {"COLUMNS": "110", "NO_COLOR": "1", "MPLBACKEND": "Agg"}
    environment = {**os.environ, **plain, "PATH": path, "DOCS": str(PAGES.parent)}
    with subprocess.Popen(
        ["bash", "-e", "-o", "pipefail", "-c", commands], start_new_session=True,
        cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as shell:  # fmt: skip
        try:
            said, _ = shell.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            # with what it left in the background: a graph ends when its asker does
            os.killpg(shell.pid, signal.SIGKILL)
            raise BenchError(f"not done after {PATIENCE:.0f} s: {commands}") from None
    said = _CONTROL.sub("", said)
    if shell.returncode:
        raise BenchError(f"exit code {shell.returncode} of: {commands}{said}")
    return "".join(line.rstrip() + "\n" for line in said.splitlines() if line.strip())


def build(names: Sequence[str], out: Path, tell: Callable[[str], None]) -> None:
    """Perform pages, write them with their pictures to `out`, and the index of all that are there.

    Raises:
        BenchError: there is no such page, or it cannot be performed.
    """
    (out / "images").mkdir(parents=True, exist_ok=True)
    for name in names:
        source = PAGES / f"{name}.md"
        if not source.exists():
            raise BenchError(f"no page '{name}' in {PAGES}; there are {', '.join(pages())}")
        page, began = source.read_text(encoding="utf-8").split(_MADE)[0], time.monotonic()
        with tempfile.TemporaryDirectory(prefix=f"gallery-{name}-") as scratch:
            try:
                text = perform(page, Path(scratch))
            except BenchError as error:
                raise BenchError(f"{source.name}: {error}") from None
            for picture in _PICTURE.findall(page):
                shutil.copyfile(Path(scratch) / picture, out / "images" / picture)
        seconds = time.monotonic() - began
        tell(f"{name}: {seconds:.0f} s")
        made = f"{_MADE}\n{provenance('make gallery').line()} The commands of this page took {seconds:.0f} s.\n"
        (out / source.name).write_text(text + made, encoding="utf-8")
    (out / _INDEX).write_text(index(out), encoding="utf-8")


def pages() -> list[str]:
    """Names of all pages."""
    return sorted(path.stem for path in PAGES.glob("*.md") if path.name != _INDEX)


def index(out: Path) -> str:
    """Every page's title, first paragraph and first picture."""
    entries = []
    for path in sorted(path for path in out.glob("*.md") if path.name != _INDEX):
        page = path.read_text(encoding="utf-8")
        title, first, *_ = page.removeprefix("# ").split("\n\n")
        picture = _PICTURE.search(page)
        entries.append(f"## [{title}]({path.name})\n\n{first}\n\n{picture[0] if picture else ''}\n")
    head = "# Gallery\n\nEach page is a thing to do, from nothing to a picture, in commands that the tests run.\n"
    return "\n".join([head, *entries])


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m pzt_benchmarks.gallery", description=__doc__)
    parser.add_argument("pages", nargs="*", help=f"some of {', '.join(pages())}; all by default")
    parser.add_argument("--out", type=Path, default=PAGES, help="folder for the pages; where they are by default")
    given = parser.parse_args()
    try:
        build(given.pages or pages(), given.out, lambda text: print(text, flush=True))
    except BenchError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
