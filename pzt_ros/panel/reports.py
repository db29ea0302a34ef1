"""The latest report of a diagnosis, found by its files and served as it is."""

from __future__ import annotations

import time
from pathlib import Path

DEPTH = ("*", "*/*", "*/*/*")
"""So deep below the folder a report is looked for."""

LOOK_EVERY = 5.0
"""[s]"""

REPORT_PATH = "/diagnosis"


class Reports:
    """Looks for `report.html` beside the `baseline.yaml` that `pzt diagnose` writes."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._looked = float("-inf")
        self._latest: Path | None = None

    @property
    def latest(self) -> Path | None:
        """The newest report's page, or none."""
        if time.monotonic() - self._looked > LOOK_EVERY:
            self._looked = time.monotonic()
            self._latest = self._find()
        return self._latest

    @property
    def words(self) -> str:
        """Of the link; empty where there is none."""
        latest = self.latest
        return f"latest diagnosis: {latest.parent.relative_to(self._folder)}" if latest else ""

    def _find(self) -> Path | None:
        found = [path for depth in DEPTH for path in self._folder.glob(f"{depth}/report.html")]
        diagnoses = [path for path in found if (path.parent / "baseline.yaml").is_file()]
        return max(diagnoses, key=lambda path: path.stat().st_mtime, default=None)
