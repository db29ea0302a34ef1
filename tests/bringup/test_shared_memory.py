"""What a killed process left in shared memory is removed; what a living one holds is not."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pzt_bringup.command import run_graph
from pzt_bringup.domain import take_domain
from pzt_bringup.shared_memory import FOLDER, held_by, left_over, sweep
from pzt_ros.errors import BenchError


def segment(folder: Path, name: str) -> Path:
    """The files of a segment or port; returns its lock."""
    for file in (name, f"{name}_el", f"sem.{name}_mutex"):
        (folder / file).write_bytes(b"")
    return folder / f"{name}_el"


def test_only_what_is_named_and_nobody_holds_is_removed(tmp_path: Path) -> None:
    segment(tmp_path, "fastrtps_0123456789abcdef")
    segment(tmp_path, "fastrtps_port26661")
    held = segment(tmp_path, "fastrtps_port7000")  # there is a new owner already
    segment(tmp_path, "fastrtps_fedcba9876543210")  # somebody else's
    (tmp_path / "fastrtps_port7003").write_bytes(b"")  # made anew by a living writer, so without a lock
    named = ("fastrtps_0123456789abcdef", "fastrtps_port26661", "fastrtps_port7000", "fastrtps_port7003", "fastrtps_no")
    with held.open("rb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert sweep(named, tmp_path) == ["fastrtps_0123456789abcdef", "fastrtps_port26661", "fastrtps_port7003"]
    left = {path.name for path in tmp_path.iterdir()}
    kept = ("fastrtps_fedcba9876543210", "fastrtps_port7000")
    assert left == {f for n in kept for f in (n, f"{n}_el", f"sem.{n}_mutex")}


def test_only_what_has_been_there_for_a_while_is_left_over(tmp_path: Path) -> None:
    for name in ("fastrtps_0123456789abcdef", "fastrtps_port26661"):
        lock = segment(tmp_path, name)
        os.utime(lock, (time.time() - 20.0,) * 2)
    segment(tmp_path, "fastrtps_port7000")  # just being made
    (tmp_path / "somebody_el").write_bytes(b"")
    os.utime(tmp_path / "somebody_el", (0.0, 0.0))
    assert left_over(tmp_path) == {"fastrtps_0123456789abcdef", "fastrtps_port26661"}
    assert left_over(tmp_path / "nowhere") == set()


@pytest.mark.skipif(not FOLDER.is_dir(), reason="no /dev/shm on this system")
def test_a_graph_starts_without_the_ports_of_the_dead(tmp_path: Path) -> None:
    name = f"fastrtps_{os.getpid():016x}"
    os.utime(segment(FOLDER, name), (time.time() - 20.0,) * 2)
    with pytest.raises(BenchError, match="nowhere"):  # it would have started
        run_graph("scan", tmp_path, None, False, False, None, "/stage", Path("nowhere.yaml"), True)
    assert not [file for file in os.listdir(FOLDER) if name in file]


@pytest.mark.skipif(not FOLDER.is_dir(), reason="no /dev/shm on this system")
def test_what_killed_nodes_leave_is_swept_and_a_living_one_is_left_alone(tmp_path: Path) -> None:
    domains = [take_domain(None) for _ in range(2)]
    for domain in domains:
        domain.release()
    nodes = [
        subprocess.Popen(
            [sys.executable, "-m", "pzt_nodes.recorder_node", "--ros-args", "-p", f"bag:={tmp_path / str(number)}"],
            env={**os.environ, "ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        )
        for number, domain in enumerate((domains[0].domain, domains[0].domain, domains[1].domain))
    ]
    try:
        deadline = time.monotonic() + 30.0
        while not all(len(held_by(node.pid)) >= 3 for node in nodes):
            assert time.monotonic() < deadline, "the nodes have no shared memory"
            time.sleep(0.05)
        first, second, living = (held_by(node.pid) for node in nodes)
        for node in nodes[:2]:
            node.kill()
            node.wait()
        dead = first | second
        assert dead <= set(os.listdir(FOLDER)), "Fast DDS cleans up by itself: this module is not needed any more"
        swept = set(sweep(dead | living))
        left = set(os.listdir(FOLDER))
        # a number from 7000 on is taken again by the next node that starts, here or elsewhere
        own = {name for name in dead if not name.startswith("fastrtps_port7")}
        assert own <= swept
        assert not {file for file in left for name in own if name in file}
        assert living <= left
        assert not living & swept
        nodes[2].send_signal(signal.SIGINT)
        assert nodes[2].wait(20.0) == 0
    finally:
        for node in nodes:
            node.kill()
            node.wait()
