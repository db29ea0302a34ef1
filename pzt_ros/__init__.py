"""Models, observers and controllers for piezo nanopositioning stages; imports no ROS."""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path

__version__ = "0.1.0"


def _place_compiled_code() -> None:
    """Give Numba a cache folder named after our sources.

    Numba looks at the file a function stands in, not at what that file imports: after an edit elsewhere it would go on
    using old code. With the digest of the physics, and of all files that compile, in the folder's name it cannot. The
    folder is the user's, so a read-only installation works, too.
    """
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        source = path.read_bytes()
        if path.parent.name == "physics" or b"numba" in source:
            digest.update(source)
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    os.environ.setdefault("NUMBA_CACHE_DIR", str(cache / "pzt_ros" / digest.hexdigest()[:16]))
    if "numba" in sys.modules:  # another package came first, and Numba looked already
        sys.modules["numba"].config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]


_place_compiled_code()
