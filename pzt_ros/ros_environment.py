"""What a process with a ROS node finds in its environment, said once for the bringup, the panel and the doctor."""

from __future__ import annotations

import multiprocessing
import os
from importlib import resources
from pathlib import Path


def ros_environment(log_folder: Path, domain: int | None = None) -> dict[str, str]:
    """This process' environment with our defaults where the user has set nothing (docs/decisions/0003).

    Nodes log into `log_folder`; a domain that is given wins over the user's.
    """
    defaults = {
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(Path(str(resources.files("pzt_config"))) / "fastdds.xml"),
        "ROS_LOG_DIR": str(log_folder),
        "RCUTILS_COLORIZED_OUTPUT": "0",
        "PYTHONUNBUFFERED": "1",
    }
    chosen = {} if domain is None else {"ROS_DOMAIN_ID": str(domain)}
    return {**defaults, **os.environ, **chosen}


def supervised() -> dict[str, str]:
    """What tells a program that it shall not outlive this one; a fork knows without being told. See `orphaned`."""
    return {"PZT_PARENT": str(os.getpid())}


def orphaned() -> bool:
    """Whether the process that started this one, and said `supervised`, is gone: then nobody would ever stop it."""
    starter = multiprocessing.parent_process()
    if starter is not None:
        return not starter.is_alive()
    parent = os.environ.get("PZT_PARENT")
    return parent is not None and os.getppid() != int(parent)
