"""Manual operation of the running graph: enabled by hand, moved by trajectories, disabled, and enabled again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign_node import ForeignNode
from graph_process import GraphProcess, alive
from operating import Operator, trajectory
from scenarios import LONG_HOLD, write

from pzt_ros.bags.reader import open_bag
from pzt_ros.blocks import Block
from pzt_ros.experiments.trajectory import Trajectory
from pzt_ros.hardware.limits import Limits
from pzt_ros.loop import InProcessLoop
from pzt_ros.manual import ManualConductor
from pzt_ros.report.run import read_summary, write_run_report
from pzt_ros.scenario import load_scenario

QUICK = """
scenario: quick manual
plant: bench-stage
model: thesis-p2
seed: 3
rate: real time
limits: {late_commands: 0}
controllers: {inverse_pi: {integral_gain: 100 1/s}}
manual: {poling_ramp: 0.3 s, poling_hold: 0.2 s}
"""
MOVE = ((0.2, 4e-6), (0.3, 3.5e-6))
BEATS = 3
REFUSED = {
    "far": (trajectory((0.5, 60e-6)), "is beyond the stroke: it takes"),
    "wrong axis": (trajectory((0.5, 3e-6), names=("other",)), "joint_names are ['other'], expected ['stage']"),
    "not a number": (trajectory((0.5, float("nan"))), "the position of point 1 is nan m"),
    "running back": (trajectory((0.5, 3e-6), (0.4, 3e-6)), "time_from_start of point 2 is 0.4 s"),
    "too fast": (trajectory((0.00005, 4.5e-6)), "it takes a slew rate of"),
    "shapeless": (trajectory((0.5, 3e-6, 0.0, 0.0)), "1 positions and 2 velocities"),
}


def summarized(folder: Path) -> dict[str, Any]:
    """The numbers of the run's report."""
    write_run_report(folder)
    return read_summary(folder)


class Session:
    """What is left of a session at the stage."""

    def __init__(self, folder: Path, options: tuple[str, ...]) -> None:
        self.scenario = write(folder, QUICK)
        with GraphProcess(self.scenario, folder / "run", *options) as graph, ForeignNode(graph.domain) as foreign:
            operator = Operator(foreign)
            operator.wait_until_ready()
            self.before = [operator.call("pole"), operator.heard("amplifier", "state")]
            operator.say(trajectory(*MOVE))  # refused: not enabled
            for _ in range(BEATS):
                assert operator.enable() == (True, "amplifier enabled")
                operator.wait_for("experiment", "phase", "hold")
                operator.run_for(0.1)
                operator.say(trajectory(*MOVE))
                operator.run_for(0.5)
                self.reached = operator.displacement()
                for message, _ in REFUSED.values():
                    operator.say(message)
                operator.run_for(0.1)
                assert operator.enable(False)[0]
                operator.wait_for("amplifier", "state", "disabled")
            foreign.spin_until(lambda: operator.values("experiment").get("phase") == "not enabled")
            self.counts, self.plant = operator.values("experiment"), operator.values("plant")
            processes = graph.nodes()
            graph.interrupt()
            self.code, self.said = graph.wait()
            self.left = alive(processes)
        self.report = summarized(folder / "run")
        self.bag = open_bag(folder / "run" / "bag")
        self.logs = {path.name: path.read_text(encoding="utf-8") for path in (folder / "run" / "log").glob("*.log")}

    def blocks(self, name: str) -> Block:
        return self.bag.blocks(f"/stage/{name}")


@pytest.fixture(scope="module", params=[(), ("--composed",)], ids=["separate", "composed"])
def session(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Session:
    return Session(tmp_path_factory.mktemp("manual"), request.param)


def test_nothing_is_enabled_by_itself(session: Session) -> None:
    assert session.before == [(False, "the stage is not enabled; enable it first"), "disabled"]


def test_it_ends_cleanly(session: Session) -> None:
    assert session.code == 0, session.said
    assert "the amplifier brought the stack to 0 V" in session.said
    assert session.left == []
    assert session.bag.complete
    for name, log in session.logs.items():
        assert "Traceback" not in log, name
        assert "[ERROR]" not in log, name


def test_time_goes_on_through_every_disabling(session: Session) -> None:
    times = {name: session.blocks(name).time for name in ("applied", "truth", "measurement", "estimate")}
    for name, time in times.items():
        np.testing.assert_array_equal(time, np.arange(len(time)) / 20e3, err_msg=name)
        assert len(time) == len(times["applied"]), name


def test_enabling_and_disabling_never_make_the_voltage_jump(session: Session) -> None:
    voltage = session.blocks("applied")["voltage_V"]
    step = np.abs(np.diff(voltage))
    assert step.max() < 0.1  # 2 kV/s, of 200 kV/s allowed
    at_rest = voltage == 0.0
    assert np.count_nonzero(at_rest[1:] & ~at_rest[:-1]) == BEATS, "0 V is reached once after each beat"
    ramps = np.diff(voltage)[np.flatnonzero(at_rest[1:] & ~at_rest[:-1]) - 1]
    np.testing.assert_allclose(ramps, -Limits().safe_rate / 20e3, rtol=1e-6, err_msg="the ramp is at the safe rate")


def test_the_stage_follows_the_trajectory(session: Session) -> None:
    assert session.reached == pytest.approx(3.5e-6, abs=0.3e-6)  # steps of 0.1 um, noise of 20 nm
    reference, truth = session.blocks("reference"), session.blocks("truth")
    begins = np.flatnonzero(np.diff(reference.time, prepend=-1.0) > 1.5 / 20e3)
    assert len(begins) == BEATS
    for beat in np.split(reference["displacement_m"], begins[1:]):
        assert beat[0] == beat[99], "it holds at first"
        assert np.max(beat) == pytest.approx(4e-6, abs=1e-9)
    ends = [*(begins[1:] - 101), len(reference) - 101]  # the last one may not have been followed any more
    for end in ends:
        assert reference["displacement_m"][end] == pytest.approx(3.5e-6, abs=1e-15)
        place = np.searchsorted(truth.time, reference.time[end])
        assert truth["displacement_m"][place] == pytest.approx(3.5e-6, abs=0.1e-6)


def test_what_is_refused_is_said_and_counted(session: Session) -> None:
    said = "".join(session.logs.values())
    assert said.count("trajectory refused: the stage is not enabled; enable it first") == 1
    for what, (_, expected) in REFUSED.items():
        lines = [line for line in said.splitlines() if "trajectory refused" in line and expected in line]
        assert len(lines) == BEATS, what
    assert session.counts["refused on joint_trajectory"] == str(1 + BEATS * len(REFUSED))
    assert session.counts["trajectories_followed"] == str(BEATS)


def test_the_run_is_not_ahead_of_the_wall_clock_while_enabled(session: Session) -> None:
    assert 100 < int(session.plant["paced_ticks"]) < len(session.blocks("applied")) / 100
    assert int(session.plant["missed_ticks"]) <= int(session.plant["paced_ticks"])
    wall = 1e-9 * np.array([when for when, _ in session.bag.messages("/stage/reference")])
    own = session.blocks("reference").time[::100]
    beats = np.split(np.arange(len(own)), np.flatnonzero(np.diff(own) > 1.5 * 0.005) + 1)
    assert len(beats) == BEATS
    for beat in beats:  # what comes before the plant has heard of the beat is not paced
        assert own[beat[-1]] - own[beat[0]] <= wall[beat[-1]] - wall[beat[0]] + 0.1


def test_the_first_beat_is_that_of_the_in_process_loop(session: Session) -> None:
    """To the bit, once the trajectory is given to it before the same block."""
    loop = InProcessLoop(load_scenario(session.scenario))
    assert isinstance(loop.experiment, ManualConductor)
    reference = session.blocks("reference")
    asked = reference["displacement_m"]
    moved = int(np.flatnonzero(asked != asked[0])[0]) // 100
    count = int(np.flatnonzero(np.diff(reference.time) > 1.5 / 20e3)[0]) // 100 - 1
    tick, ticks = loop.start(), []
    for block in range(count):
        if block == moved:
            times, places = np.array(MOVE).T
            loop.experiment.follow(Trajectory(("stage",), 0.0, times, places, np.full(2, np.nan)))
        following = loop.step(tick)
        assert following is not None
        ticks.append(tick := following)
    for name, column, found in (
        ("reference", "displacement_m", [t.reference.values for t in ticks if t.reference is not None]),
        ("drive", "command_voltage_V", [t.command_voltage for t in ticks]),
        ("truth", "displacement_m", [t.truth.displacement for t in ticks]),
        ("estimate", "displacement_m", [t.estimate.displacement for t in ticks]),
    ):
        skipped = 0 if name in ("reference", "drive") else 100  # block 0 is nobody's answer
        graph = session.blocks(name)[column][skipped : skipped + 100 * count]
        np.testing.assert_array_equal(graph, np.concatenate(found), err_msg=name)


def test_the_report_says_how_well_the_operator_was_followed(session: Session) -> None:
    assert "it followed the reference with an RMS error of" in session.report["verdict"]
    assert session.report["incomplete"] == ""
    assert session.report["gaps"] == ""
    assert session.report["pace"]["paced_ticks"] >= int(session.plant["paced_ticks"]) > 100
    assert session.report["pace"]["lateness_p50_us"] <= session.report["pace"]["lateness_max_us"]
    assert session.report["counts"]["/stage/experiment"]["refused on joint_trajectory"] == 1 + BEATS * len(REFUSED)


def test_a_session_ends_after_its_duration_and_poles_meanwhile(tmp_path: Path) -> None:
    longer = QUICK.replace("poling_hold: 0.2 s", "poling_hold: 3 s")  # so that a slow machine asks again meanwhile
    with GraphProcess(write(tmp_path, longer), tmp_path / "run", "--duration", "12") as graph:
        with ForeignNode(graph.domain) as foreign:
            operator = Operator(foreign)
            operator.wait_until_ready()
            operator.enable()
            operator.wait_for("experiment", "phase", "hold")
            assert operator.call("pole") == (True, "poling has begun and takes 3.6 s")
            assert operator.call("pole")[1].startswith("cannot pole: the stage is being poled for another ")
            operator.say(trajectory(*MOVE))
            operator.wait_for("experiment", "phase", "hold")
            operator.run_for(0.1)
            foreign.spin_until(lambda: graph.process.poll() is not None)
        code, said = graph.wait()
    assert code == 0, said
    assert "run complete" in said
    bag = open_bag(tmp_path / "run" / "bag")
    assert bag.complete
    applied = bag.blocks("/stage/applied")["voltage_V"]
    assert applied.max() == pytest.approx(150.0, abs=0.01)
    assert np.max(np.abs(np.diff(applied))) < 0.2
    assert applied[-1] == 0.0
    asked = bag.blocks("/stage/voltage_reference")["voltage_V"]
    assert asked.max() == pytest.approx(150.0)
    assert asked[-1] == pytest.approx(0.0, abs=1e-9)
    log = (tmp_path / "run" / "log" / "experiment.log").read_text(encoding="utf-8")
    assert "trajectory refused: the stage is being poled for another" in log


def test_a_scenario_keeps_the_stage_for_itself(tmp_path: Path) -> None:
    with GraphProcess(write(tmp_path, LONG_HOLD), tmp_path / "run", "--real-time") as graph:
        with ForeignNode(graph.domain) as foreign:
            operator = Operator(foreign)
            operator.wait_until_ready()
            assert operator.call("pole") == (False, "a scenario has the stage; requests are for the scenario 'manual'")
            operator.say(trajectory(*MOVE))
            operator.wait_for("experiment", "refused on joint_trajectory", "1")
        graph.interrupt()
        code, said = graph.wait()
    assert code == 0, said
