"""What a process with a ROS node finds in its environment, said once for the bringup, the panel and the doctor."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

_PROFILES, _RANGE = "FASTRTPS_DEFAULT_PROFILES_FILE", "ROS_AUTOMATIC_DISCOVERY_RANGE"
_CHOICES = (_PROFILES, "FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS", "ROS_STATIC_PEERS")
"""Who has set one of these has thought about transports, and gets what he set; our profile for other tools is no such
thing."""

_APART = (
    "<propertiesPolicy><properties><property><name>fastdds.ignore_local_endpoints</name><value>true</value>"
    "</property></properties></propertiesPolicy>"
)


def ros_environment(log_folder: Path, domain: int | None = None) -> dict[str, str]:
    """This process' environment with our defaults where the user has set nothing (docs/decisions/0003).

    Nodes log into `log_folder`; a domain that is given wins over the user's.
    """
    defaults = {
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_LOG_DIR": str(log_folder),
        "RCUTILS_COLORIZED_OUTPUT": "0",
        "PYTHONUNBUFFERED": "1",
    }
    chosen = {} if domain is None else {"ROS_DOMAIN_ID": str(domain)}
    return {**defaults, **_transport(os.environ), **chosen}


def _transport(given: Mapping[str, str]) -> dict[str, str]:
    """An environment in which nodes talk over UDP: on the loopback interface, unless it says otherwise.

    What rmw makes of LOCALHOST has shared memory too, so LOCALHOST is said to Fast DDS itself, by a profile.
    """
    ours = _profile("fastdds.xml")
    if any(given.get(name, ours) not in ("", ours) for name in _CHOICES):
        return {_RANGE: "LOCALHOST", _PROFILES: ours, **given}
    local = given.get("ROS_LOCALHOST_ONLY") == "1" or given.get(_RANGE, "LOCALHOST") == "LOCALHOST"
    if not local:
        return {**given, "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4", _PROFILES: ours}
    said = {_RANGE: "SYSTEM_DEFAULT", _PROFILES: _profile("fastdds_loopback.xml")}
    return {name: text for name, text in {**given, **said}.items() if name != "ROS_LOCALHOST_ONLY"}


def keep_apart() -> bool:
    """Have Fast DDS connect nothing within this process; say so before its first node is made.

    Its own name for it is `ignore_local_endpoints`. What goes to other processes is then sent by a thread of its own,
    and no node here waits for it. False where it is not ours to say: a profile of the user's, or another DDS, stays as
    it is.
    """
    profile, logs = os.environ.get(_PROFILES, ""), os.environ.get("ROS_LOG_DIR", "")
    ours = profile in [_profile(name) for name in ("fastdds.xml", "fastdds_loopback.xml")]
    if not ours or not logs or os.environ.get("RMW_IMPLEMENTATION") != "rmw_fastrtps_cpp":
        return False
    text = Path(profile).read_text(encoding="utf-8")
    changed = Path(logs, "fastdds_apart.xml")
    changed.parent.mkdir(parents=True, exist_ok=True)
    changed.write_text(text.replace("<rtps>", "<rtps>" + _APART, 1), encoding="utf-8")
    os.environ[_PROFILES] = str(changed)
    os.environ.setdefault("RMW_FASTRTPS_PUBLICATION_MODE", "ASYNCHRONOUS")
    return True


def _profile(name: str) -> str:
    return str(Path(str(resources.files("pzt_config"))) / name)


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
