"""Copies the README's pictures of the demo out of a demo that was run: `make demo`, then `python docs/make_demo.py`."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

FOLDER = Path(__file__).parent
PICTURES = {"controllers/figures/overview": "demo", "figures/story": "demo-story"}
"""Where a demo leaves a picture, and what the README calls it."""


def main() -> None:
    """Copy both themes of each picture."""
    demo = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER.parent / "demo"
    for source, name in PICTURES.items():
        for theme in ("", "-dark"):
            picture = demo / f"{source}{theme}.png"
            if not picture.is_file():
                raise SystemExit(f"error: {picture} is not there; run `make demo` first, or give the folder of a demo")
            shutil.copyfile(picture, FOLDER / "images" / f"{name}{theme}.png")


if __name__ == "__main__":
    main()
