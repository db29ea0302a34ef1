"""`pzt run` ends its graph whoever is told to stop, and however: the stage is at 0 V, and no process is left."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from graph_process import PATIENCE, alive, wait_until
from scenarios import LONG_HOLD, write

from pzt_ros.bags.reader import open_bag


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_signal_to_pzt_run_alone_brings_the_stage_to_rest(number: signal.Signals, tmp_path: Path) -> None:
    scenario, run = write(tmp_path, LONG_HOLD), tmp_path / "run"
    pzt = Path(sys.executable).with_name("pzt")
    process = subprocess.Popen(
        [str(pzt), "run", str(scenario), "--out", str(run), "--composed"], stderr=subprocess.PIPE, text=True,
        start_new_session=True,  # no terminal that would tell the graph, too
    )  # fmt: skip
    log = run / "bag"
    wait_until(lambda: any(p.stat().st_size > 1_000_000 for p in log.glob("*.mcap")), "blocks in the bag")
    graph = psutil.Process(process.pid).children(recursive=True)
    process.send_signal(number)
    _, said = process.communicate(timeout=PATIENCE)
    wait_until(lambda: not alive(graph), "the end of the graph")
    outcome = json.loads((run / "run.json").read_text(encoding="utf-8"))["outcome"]
    assert outcome["exit_code"] == 0, said
    assert "brought the stack to 0 V" in outcome["sentence"]
    assert open_bag(log).blocks("/stage/applied")["voltage_V"][-1] == 0.0
    if number != signal.SIGKILL:
        assert process.returncode == 0, said
        assert "Traceback" not in said
