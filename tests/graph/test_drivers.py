"""The same graph with other instruments: a piezo controller on a real socket, and what they do to the stage in time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from driver_graph import DriverGraph, recorded
from foreign_node import ForeignNode
from gcs_server import SILENT, GcsServer
from graph_process import alive
from operating import Operator, trajectory
from scenarios import SHORT, write

from pzt_ros.bags.reader import open_bag
from pzt_ros.records import Record, write_csv

SLOW = """
scenario: slow
plant: thesis-p2
model: thesis-p2
sample_rate: 200 Hz
block_size: 10
limits: {voltage_min: -20 V, voltage_max: 110 V, slew_rate: 1 kV/s, safe_rate: 400 V/s, command_timeout: 3 s}
phases:
  - {phase: voltage, to: 100 V, duration: 1 s}
  - {phase: voltage, to: 100 V, duration: HOLD}
  - {phase: voltage, to: 0 V, duration: 1 s}
"""


def test_a_stage_that_gets_too_hot_is_brought_to_safety(tmp_path: Path) -> None:
    scenario = write(tmp_path, SHORT.replace("limits: {", "limits: {temperature: 320 K, "))
    record = recorded(scenario).between(0.0, 1.0)
    warming = {**record.columns, "temperature_K": np.linspace(300.0, 340.0, len(record))}
    write_csv(Record("warm", warming), tmp_path / "run.csv")
    driver = f"{{driver: replay, record: {tmp_path / 'run.csv'}}}"
    with DriverGraph(scenario, f"amplifier: {driver}\nsensor: {driver}\n", tmp_path / "run", "--real-time") as graph:
        code, said = graph.wait()
    assert code == 1, said
    assert "the amplifier went to ramping: temperature of 32" in said
    assert "limit 320.0 K" in said
    last = open_bag(tmp_path / "run" / "bag").blocks("/stage/drive").time[-1]
    assert 0.4 < last < 0.8, "half way through the record it is 320 K"


def controller(server: GcsServer, timeout: str = "2 s") -> str:
    """Both drivers of one controller."""
    driver = f"driver: gcs, host: 127.0.0.1, port: {server.port}, timeout: {timeout}"
    return f"amplifier: {{{driver}, capacitance: 1 uF}}\nsensor: {{{driver}, oldest: 2 s}}\n"


def test_a_controller_is_driven_over_its_socket(tmp_path: Path) -> None:
    with GcsServer(voltage=30.0) as server:
        with DriverGraph(write(tmp_path, SLOW.replace("HOLD", "0.2 s")), controller(server), tmp_path / "run") as graph:
            code, said = graph.wait()
            assert code == 0, said
        assert server.voltage == 0.0
        history = np.array(server.history)
        assert history.max() == np.float64(100.0)
        assert np.max(np.abs(np.diff(history))) <= 5.0 + 1e-5, "no jump, from 30 V found at the stack on"
    bag = open_bag(tmp_path / "run" / "bag")
    applied, measured = bag.blocks("/stage/applied"), bag.blocks("/stage/measurement")
    assert applied["voltage_V"][0] == 30.0
    assert applied["voltage_V"].max() == 100.0
    assert applied["current_A"].max() > 1e-5
    assert np.ptp(measured["displacement_m"]) > 1e-7
    held = measured["displacement_m"][(measured.time > 1.1) & (measured.time < 1.2)]
    assert np.ptp(held) < 0.05 * np.ptp(measured["displacement_m"])


def fault(tmp_path: Path, harm: Callable[[GcsServer], None], heal: Callable[[GcsServer], None], says: str) -> None:
    """A controller that is harmed at 100 V and healed when the amplifier has noticed: 0 V, and no rise on the way."""
    with GcsServer() as server:
        scenario = write(tmp_path, SLOW.replace("HOLD", "600 s"))
        with DriverGraph(scenario, controller(server, "0.3 s"), tmp_path / "run") as graph:
            graph.wait_while_running(lambda: server.voltage == 100.0, "100 V at the stack")
            processes = graph.nodes()
            harm(server)
            graph.wait_for_log("amplifier", "amplifier ramping: ", says)
            count = len(server.history)
            heal(server)
            code, said = graph.wait()
        assert code == 1, said
        assert says in said
        assert alive(processes) == []
        assert server.voltage == 0.0
        assert max(np.diff(server.history[count - 1 :]), default=0.0) <= 1e-5


def test_a_controller_that_falls_silent_is_a_fault_and_is_brought_down_when_it_is_back(tmp_path: Path) -> None:
    def harm(server: GcsServer) -> None:
        server.trouble.update({"VOL?": SILENT})

    def heal(server: GcsServer) -> None:
        server.trouble.clear()
        server.hang_up()

    fault(tmp_path, harm, heal, "gave no complete answer to 'VOL? 1' within 0.3 s")


def test_a_sensor_that_falls_silent_is_a_fault(tmp_path: Path) -> None:
    def harm(server: GcsServer) -> None:
        server.trouble.update({"POS?": SILENT})

    fault(tmp_path, harm, lambda server: server.trouble.clear(), "no measurement for")


BY_HAND = """
plant: thesis-p2
model: thesis-p2
sample_rate: 200 Hz
block_size: 10
rate: real time
limits:
  {voltage_min: -20 V, voltage_max: 110 V, slew_rate: 1 kV/s, safe_rate: 400 V/s, command_timeout: 3 s,
   late_commands: 0}
manual: {controller: inverse}
"""


def test_a_stack_found_charged_is_held_and_driven_by_hand_without_a_jump(tmp_path: Path) -> None:
    with GcsServer(voltage=30.0) as server:
        with DriverGraph(write(tmp_path, BY_HAND), controller(server), tmp_path / "run") as graph:
            with ForeignNode(graph.domain) as foreign:
                operator = Operator(foreign)
                operator.wait_until_ready()
                assert server.history == [30.0], "nothing is put out before it is enabled"
                for _ in range(2):
                    assert operator.enable()[0]
                    operator.wait_for("experiment", "phase", "hold")
                    operator.run_for(0.5)
                    here = operator.displacement()
                    operator.say(trajectory((1.0, here + 1e-6)))
                    operator.wait_for("experiment", "phase", "trajectory")
                    operator.wait_for("experiment", "phase", "hold")
                    assert operator.enable(False)[0]
                    operator.wait_for("amplifier", "state", "disabled")
            graph.interrupt()
            code, said = graph.wait()
        assert code == 0, said
        history = np.array(server.history)
    assert history[-1] == 0.0
    assert 35.0 < history.max() < 60.0
    assert np.max(np.abs(np.diff(history))) <= 400.0 / 200.0 + 1e-5, "no step is larger than the ramp's"


def test_a_controller_is_driven_from_one_process(tmp_path: Path) -> None:
    with GcsServer(voltage=30.0) as server:
        scenario = write(tmp_path, SLOW.replace("HOLD", "0.2 s"))
        with DriverGraph(scenario, controller(server), tmp_path / "run", "--composed") as graph:
            code, said = graph.wait()
            assert code == 0, said
        assert server.voltage == 0.0
        assert max(server.history) == 100.0
        assert np.max(np.abs(np.diff(server.history))) <= 5.0 + 1e-5
    measured = open_bag(tmp_path / "run" / "bag").blocks("/stage/measurement")
    assert np.ptp(measured["displacement_m"]) > 1e-7
