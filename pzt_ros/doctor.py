"""What is in the way of a graph on this machine: each check says what it found, and what to do about it."""

from __future__ import annotations

import importlib.util
import json
import os
import platform
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pzt_ros.graphs import running_graphs
from pzt_ros.ros_environment import ros_environment

OK, NOTE, PROBLEM = "ok", "note", "problem"

PYTHONS = ((3, 10), (3, 13))
"""The oldest and the newest that the ROS wheels and numba are there for."""


@dataclass(frozen=True)
class Finding:
    """What a check found.

    Attributes:
        check: its name.
        level: ok, note (it works, but) or problem.
        found: one line.
        advice: what to do; empty where nothing has to be.
    """

    check: str
    level: str
    found: str
    advice: str = ""


def examine() -> list[Finding]:
    """Every check in turn; the round trip takes some seconds."""
    return [check() for check in CHECKS]


# -- what is installed


def python(version: tuple[int, int] | None = None) -> Finding:
    """Whether this Python is one that the wheels are made for."""
    version = version or sys.version_info[:2]
    found = f"Python {version[0]}.{version[1]} in {sys.prefix}"
    oldest, newest = (".".join(map(str, one)) for one in PYTHONS)
    if PYTHONS[0] <= version <= PYTHONS[1]:
        return Finding("python", OK, found)
    return Finding("python", PROBLEM, found, f"use Python {oldest} to {newest}: make PYTHON=python3.12")


def machine(system: str = "", processor: str = "", libc: str = "") -> Finding:
    """Whether the ROS wheels run on this machine at all."""
    system, processor = system or platform.system(), processor or platform.machine()
    libc = libc or platform.libc_ver()[1] or "0"
    found = f"{system} on {processor}, glibc {libc}"
    if system != "Linux" or processor != "x86_64":
        advice = "the ROS wheels are for Linux on x86-64 only; elsewhere source a ROS 2 Jazzy"
        return Finding("machine", PROBLEM, found, advice)
    if tuple(map(int, libc.split(".")[:2])) < (2, 28):
        advice = "the ROS wheels need glibc 2.28 or newer: Debian 10, Ubuntu 20.04 or later"
        return Finding("machine", PROBLEM, found, advice)
    return Finding("machine", OK, found)


def ros(environment: Mapping[str, str] | None = None, origin: str | None = None) -> Finding:
    """Which rclpy is imported: that of the wheels, or of a ROS that was sourced."""
    environment = os.environ if environment is None else environment
    origin = _origin_of_rclpy() if origin is None else origin
    sourced = environment.get("ROS_DISTRO", "")
    if not origin:
        return Finding("ros", PROBLEM, "no rclpy", "pip install pzt_ros, or source a ROS 2 Jazzy")
    if Path(origin).is_relative_to(sys.prefix):
        if not sourced:
            return Finding("ros", OK, "rclpy from the wheels")
        advice = "open a shell in which ROS is not sourced: two rclpy in one process do not mix"
        return Finding("ros", NOTE, f"rclpy from the wheels, but ROS '{sourced}' is sourced, too", advice)
    if sourced != "jazzy":
        found = f"rclpy of ROS '{sourced or 'unknown'}' in {origin}"
        return Finding("ros", PROBLEM, found, "source ROS 2 Jazzy, or use the wheels")
    return Finding("ros", OK, f"rclpy of the sourced ROS 'jazzy' in {origin}")


def _origin_of_rclpy() -> str:
    spec = importlib.util.find_spec("rclpy")
    return str(spec.origin) if spec and spec.origin else ""


def rmw(environment: Mapping[str, str] | None = None) -> Finding:
    """Which DDS speaks for ROS."""
    environment = os.environ if environment is None else environment
    chosen = environment.get("RMW_IMPLEMENTATION", "")
    if chosen in ("", "rmw_fastrtps_cpp"):
        return Finding("rmw", OK, f"rmw_fastrtps_cpp{'' if chosen else ' (by default)'}")
    advice = "only rmw_fastrtps_cpp was measured, and no other comes as a wheel; unset RMW_IMPLEMENTATION"
    return Finding("rmw", NOTE, chosen, advice)


def panel() -> Finding:
    """Whether `pzt panel` can be started."""
    if importlib.util.find_spec("nicegui"):
        return Finding("panel", OK, "NiceGUI is installed")
    return Finding("panel", NOTE, "NiceGUI is not installed", "for pzt panel: pip install 'pzt_ros[panel]'")


# -- what the nodes meet


def discovery(try_it: Callable[[], dict[str, float]] | None = None) -> Finding:
    """Whether two processes with a node each find one another, and how fast they talk."""
    measured = (try_it or _round_trip)()
    if not measured:
        advice = (
            "see that the loopback interface is up, no firewall is on it, and ROS_DOMAIN_ID, ROS_STATIC_PEERS and"
            " ROS_AUTOMATIC_DISCOVERY_RANGE are not set to something else"
        )
        return Finding("discovery", PROBLEM, "two nodes on this machine do not hear one another", advice)
    found = f"found after {measured['found_after_s']:.2f} s, {1e6 * measured['round_trip_s']:.0f} us there and back"
    if measured["found_after_s"] > 2.0:
        advice = "a participant that died haunts the domain for seconds; wait, then try again"
        return Finding("discovery", NOTE, found, advice)
    return Finding("discovery", OK, found)


def _round_trip() -> dict[str, float]:
    command = [sys.executable, "-m", "pzt_nodes.round_trip"]
    with tempfile.TemporaryDirectory() as logs:
        try:
            done = subprocess.run(
                command, env=ros_environment(Path(logs)), capture_output=True, text=True, timeout=30.0, check=False
            )
            return dict(json.loads(done.stdout.strip().splitlines()[-1]))
        except (subprocess.TimeoutExpired, IndexError, ValueError):
            return {}


def buffers(file: Path = Path("/proc/sys/net/core/rmem_max"), wanted: int = 4194304) -> Finding:
    """How much the system lets a node receive before it looks; Linux before 6.16 allows 0.2 MB."""
    try:
        allowed = int(file.read_text(encoding="ascii"))
    except (OSError, ValueError) as error:
        return Finding("receive buffers", NOTE, f"{file}: {error}", "see that net.core.rmem_max is 4 MB or more")
    found = f"{allowed / 1e6:.1f} MB allowed"
    if allowed < wanted:
        advice = (
            "on busy cores a run as fast as possible may leave gaps in its bag:"
            f" sudo sysctl -w net.core.rmem_max={wanted} net.core.wmem_max={wanted}"
        )
        return Finding("receive buffers", NOTE, found, advice)
    return Finding("receive buffers", OK, found)


def shared_memory(folder: Path = Path("/dev/shm")) -> Finding:
    """Whether other ROS tools have room in shared memory, and how much dead ones left there; the graph uses none."""
    try:
        free = shutil.disk_usage(folder).free
        left = [path.stat().st_size for path in folder.glob("fastrtps_*")]
    except OSError as error:
        return Finding("shared memory", NOTE, f"{folder}: {error.strerror}", "the graph needs none")
    found = f"{free / 1e6:.0f} MB free; {len(left)} files of DDS, {sum(left) / 1e6:.0f} MB"
    if not os.access(folder, os.W_OK) or free < 64e6:
        advice = "the graph needs none, other ROS tools some MB each: make room, or give a container --shm-size=256m"
        return Finding("shared memory", NOTE, found, advice)
    if sum(left) > 100e6:
        advice = "most are of ROS tools that were killed; with none running: rm /dev/shm/fastrtps_*"
        return Finding("shared memory", NOTE, found, advice)
    return Finding("shared memory", OK, found)


def domain(environment: Mapping[str, str] | None = None, running: Mapping[int, int] | None = None) -> Finding:
    """Which ROS domains are in use by graphs of this machine, and which is the shell's."""
    environment = os.environ if environment is None else environment
    running = running_graphs() if running is None else running
    wanted = environment.get("ROS_DOMAIN_ID", "")
    graphs = ", ".join(f"{number} (process {pid})" for number, pid in running.items())
    shell = f"ROS_DOMAIN_ID is {wanted}" if wanted else "ROS_DOMAIN_ID is not set"
    found = f"{shell}; graphs run in: {graphs or 'none'}"
    if wanted and not (wanted.isdigit() and int(wanted) <= 232):
        return Finding("domain", PROBLEM, found, "unset ROS_DOMAIN_ID, or set it to 0 to 101")
    if wanted and int(wanted) > 101:
        return Finding("domain", NOTE, found, "domains over 101 share ports with outgoing connections; use 0 to 101")
    if graphs:
        advice = "other tools see a graph in its domain only: ROS_DOMAIN_ID=N ros2 topic list"
        return Finding("domain", NOTE, found, advice)
    return Finding("domain", OK, found)


# -- what the machine can do


def cores(count: int = 0, load: float | None = None) -> Finding:
    """Whether the graph of separate processes has the processors it needs."""
    count = count or len(os.sched_getaffinity(0))
    load = os.getloadavg()[0] if load is None else load
    found = f"{count} cores, load {load:.1f}"
    if count < 2:
        return Finding("cores", NOTE, found, "run the loop in one process: pzt run --composed")
    if load > count:
        return Finding("cores", NOTE, found, "other jobs fill this machine: blocks will come late in real time")
    return Finding("cores", OK, found)


def clock(overshoot: float | None = None) -> Finding:
    """How late a process wakes up that asked for a millisecond."""
    late = _wake_up_late() if overshoot is None else overshoot
    source = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")
    name = source.read_text(encoding="ascii").strip() if source.exists() else "unknown"
    found = f"a sleep of 1 ms is late by {1e3 * late:.2f} ms at 99 %; clock source {name}"
    if late > 2e-3:
        advice = "a block lasts 5 ms: stop other jobs, or give the graph a real-time priority"
        return Finding("clock", NOTE, found, advice)
    return Finding("clock", OK, found)


def _wake_up_late(times: int = 200) -> float:
    """The 99th percentile of the overshoot of a sleep of 1 ms [s]."""
    late = np.empty(times)
    for k in range(times):
        begin = time.monotonic()
        time.sleep(1e-3)
        late[k] = time.monotonic() - begin - 1e-3
    return float(np.percentile(late, 99.0))


def priority(limit: int | None = None, root: bool | None = None) -> Finding:
    """Whether a process may ask for a real-time priority."""
    limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0] if limit is None else limit
    root = os.geteuid() == 0 if root is None else root
    kernel = "real-time kernel" if Path("/sys/kernel/realtime").exists() else "ordinary kernel"
    if root or limit > 0:
        return Finding("priority", OK, f"{kernel}; real-time priorities are allowed{'' if root else f' up to {limit}'}")
    advice = "for fewer late blocks: '@realtime - rtprio 50' in /etc/security/limits.conf, then chrt -r 10 pzt run ..."
    return Finding("priority", NOTE, f"{kernel}; real-time priorities are not allowed", advice)


def awake(device: Path = Path("/dev/cpu_dma_latency")) -> Finding:
    """Whether the bringup may keep the processor from sleeping between two hops of a tick."""
    if os.access(device, os.W_OK):
        return Finding("awake processor", OK, f"{device} may be written")
    advice = (
        "ticks take 1.3 times as long; a udev rule gives it to a group: "
        'KERNEL=="cpu_dma_latency", MODE="0660", GROUP="realtime"'
    )
    return Finding("awake processor", NOTE, f"{device} may not be written", advice)


CHECKS: tuple[Callable[[], Finding], ...] = (
    python, machine, ros, rmw, panel, discovery, buffers, shared_memory, domain, cores, clock, priority, awake,
)  # fmt: skip
"""In the order in which they are shown; a new one is one function and one name here."""
