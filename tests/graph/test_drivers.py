"""The same graph with other instruments: a recorded run, and a piezo controller on a real socket."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from foreign_node import ForeignNode
from gcs_server import SILENT, GcsServer
from graph_process import GraphProcess, alive, wait_until
from operating import Operator, trajectory
from scenarios import SHORT, write

from pzt_ros.bags.reader import open_bag
from pzt_ros.loop import Tick, run_in_process
from pzt_ros.records import Record, write_csv
from pzt_ros.scenario import load_scenario

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


class DriverGraph(GraphProcess):
    """A graph whose drivers are named in a file."""

    def __init__(self, scenario: Path, drivers: str, folder: Path, *options: str) -> None:
        chosen = scenario.with_name("drivers.yaml")
        chosen.write_text(drivers, encoding="utf-8")
        super().__init__(scenario, folder, "--drivers", str(chosen), *options)

    def log(self, node: str) -> str:
        path = self.folder / "log" / f"{node}.log"
        return path.read_text(encoding="utf-8") if path.exists() else ""

    def wait_for_log(self, node: str, *words: str) -> None:
        self.wait_while_running(
            lambda: all(word in self.log(node) for word in words), f"'{words}' in the log of {node}"
        )

    def wait_while_running(self, happened: Callable[[], bool], what: str) -> None:
        def happened_while_running() -> bool:
            assert self.process.poll() is None, self.wait()
            return happened()

        wait_until(happened_while_running, what)


def recorded(scenario: Path) -> Record:
    """A run of the scenario, simulated in this process, and what its instruments said."""
    columns: dict[str, list[np.ndarray]] = {"time_s": [], "voltage_V": [], "displacement_m": [], "current_A": []}

    def watch(tick: Tick) -> None:
        for name, values in zip(
            columns, (tick.applied.time, tick.applied.voltage, tick.measurement, tick.applied.current), strict=True
        ):
            columns[name].append(values)

    run_in_process(load_scenario(scenario), watch)
    return Record("simulated", {name: np.concatenate(blocks) for name, blocks in columns.items()})


def test_a_recorded_run_is_played_as_if_it_were_the_instrument(tmp_path: Path) -> None:
    scenario = write(tmp_path, SHORT)
    record = recorded(scenario)
    write_csv(record.between(0.0, 1.0), tmp_path / "run.csv")
    driver = f"{{driver: replay, record: {tmp_path / 'run.csv'}}}"
    with DriverGraph(scenario, f"amplifier: {driver}\nsensor: {driver}\n", tmp_path / "run") as graph:
        code, said = graph.wait()
        assert code == 0, said
    status = graph.run_json()
    assert status["simulated"] is False
    assert status["drivers"] == {"amplifier": "replay", "sensor": "replay"}
    assert not (tmp_path / "run" / "log" / "plant.log").exists()
    assert "is over after 1 s: holding its last sample" in graph.log("amplifier")
    assert "is over after 1 s: holding its last sample" in graph.log("sensor")
    bag = open_bag(tmp_path / "run" / "bag")
    applied, measured = bag.blocks("/stage/applied"), bag.blocks("/stage/measurement")
    count = 20_001  # samples of the record; then it holds
    np.testing.assert_array_equal(applied["voltage_V"][:count], record.voltage[:count])
    np.testing.assert_array_equal(applied["current_A"][:count], record["current_A"][:count])
    np.testing.assert_array_equal(measured["displacement_m"][:count], record.displacement[:count])
    assert set(measured["displacement_m"][count:]) == {record.displacement[count - 1]}
    assert len(bag.blocks("/stage/estimate")) == len(applied)


def test_a_record_of_another_rate_is_refused_in_one_line(tmp_path: Path) -> None:
    time = np.arange(100) / 1e3
    write_csv(Record("run", dict.fromkeys(("time_s", "voltage_V", "displacement_m"), time)), tmp_path / "run.csv")
    driver = f"{{driver: replay, record: {tmp_path / 'run.csv'}}}"
    with DriverGraph(write(tmp_path, SHORT), f"amplifier: {driver}\nsensor: {driver}\n", tmp_path / "run") as graph:
        code, said = graph.wait()
    assert code == 2, said
    assert "sampled at 1000 Hz" in said
    assert "Traceback" not in said


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


def test_replay_in_one_process_says_the_same_as_in_several(tmp_path: Path) -> None:
    scenario = write(tmp_path, SHORT)
    record = recorded(scenario)
    write_csv(record, tmp_path / "run.csv")
    driver = f"{{driver: replay, record: {tmp_path / 'run.csv'}}}"
    found = []
    for name, options in (("separate", ()), ("composed", ("--composed",))):
        with DriverGraph(scenario, f"amplifier: {driver}\nsensor: {driver}\n", tmp_path / name, *options) as graph:
            code, said = graph.wait()
            assert code == 0, said
        assert "plant" not in graph.run_json()["outcome"]["status"]
        bag = open_bag(tmp_path / name / "bag")
        found.append(
            [bag.blocks(f"/stage/{topic}").values for topic in ("drive", "applied", "measurement", "estimate")]
        )
    for separate, composed in zip(*found, strict=True):
        np.testing.assert_array_equal(separate, composed)


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
