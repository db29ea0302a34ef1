"""Faults of the whole graph: processes that are killed or stalled, Ctrl-C, hogged cores, a full disk."""

from __future__ import annotations

import contextlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64MultiArray

from pzt_benchmarks.soak.fault import AGAIN, ALONE, CLEAN, ENDED, GOES_ON, NO_MORE_BAG, NOT_CLAIMED, RELAY, Fault, Seen
from pzt_benchmarks.soak.foreign import ForeignNode
from pzt_benchmarks.soak.processes import GraphProcess, alive, wait_until
from pzt_ros.bags.reader import open_bag
from pzt_ros.hardware.limits import Limits

LIMITS, RATE = Limits(), 20e3
HOLD = """
scenario: long hold
plant: bench-stage
model: thesis-p2
phases:
  - {phase: voltage, to: 100 V, duration: 0.2 s}
  - {phase: voltage, to: 100 V, duration: 600 s}
"""
SHORT = """
scenario: short
plant: bench-stage
model: thesis-p2
limits: {command_timeout: 20 s}
phases:
  - {phase: voltage, to: 100 V, duration: 0.2 s}
  - {phase: voltage, to: 0 V, duration: 0.3 s}
"""
APPLIED = "/stage/applied"
NODES_OF_THE_LOOP = ("plant", "sensor", "observer", "controller")
AT_THE_VOLTAGE = 1_500_000
"""A bag of this size holds more than the 40 blocks in which the voltage rises, of 17 kB each [bytes]."""
TO_THE_END = 30.0
"""A graph that was told to end has ended within this time [s], with both cores busy."""


class Workshop:
    """A folder in which one graph after another is brought up; each leaves nothing but its run folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._number = 0

    @contextlib.contextmanager
    def graph(self, scenario: str, *options: str) -> Iterator[GraphProcess]:
        """A graph of its own, and its run folder removed in the end."""
        self._number += 1
        path = self.folder / f"scenario-{self._number}.yaml"
        path.write_text(scenario, encoding="utf-8")
        run = self.folder / f"run-{self._number}"
        try:
            with GraphProcess(path, run, *options) as graph:
                yield graph
        finally:
            shutil.rmtree(run, ignore_errors=True)


def bench(folder: Path) -> Any:
    """A workshop in the folder."""
    return contextlib.nullcontext(Workshop(folder))


# -- what is seen of a graph


def at_the_voltage(graph: GraphProcess) -> list[psutil.Process]:
    """Wait until there have been 100 V for a moment, to be seen by the size of the bag; the processes of the graph."""
    bag = graph.folder / "bag" / "bag_0.mcap"

    def there() -> bool:
        assert graph.process.poll() is None, graph.wait()
        return bag.exists() and bag.stat().st_size > AT_THE_VOLTAGE

    wait_until(there, "blocks of the hold in the bag")
    return graph.nodes()


def memory_of(processes: list[psutil.Process]) -> set[str]:
    """The files of Fast DDS in shared memory that processes have mapped."""
    held = set()
    for process in processes:
        with contextlib.suppress(psutil.NoSuchProcess):
            held |= {m.path for m in process.memory_maps() if "/dev/shm/" in m.path and "fastrtps" in m.path}
    return held


def left_behind(processes: list[psutil.Process], memory: set[str]) -> str:
    """Processes and shared memory that are still there; empty where nothing is."""
    orphans = [process.name() for process in alive(processes)]
    litter = {path for path in memory if Path(path).exists()}
    return f"left behind: {orphans} {sorted(litter)}" if orphans or litter else ""


def tracebacks(graph: GraphProcess, said: str) -> str:
    """The logs that have a traceback in them, or the last words of an interpreter that crashed."""
    texts = {path.name: path.read_text(encoding="utf-8", errors="replace") for path in graph.folder.glob("log/*.log")}
    words = ("Traceback", "Fatal Python error")
    found = [name for name, text in {**texts, "terminal": said}.items() if any(word in text for word in words)]
    return f"traceback in {found}" if found else ""


def zero_time(graph: GraphProcess, since: float) -> float:
    """How long after `since` [s since 1970] the bag says 0 V for good [s]."""
    moments = [(when * 1e-9, message.data[-3]) for when, message in open_bag(graph.folder / "bag").messages(APPLIED)]
    if moments[-1][1] != 0.0:
        return float("inf")
    risen = [when for when, volts in moments if volts != 0.0]
    return next(when for when, volts in moments if volts == 0.0 and when > risen[-1]) - since


# -- killed


def killed(workshop: Workshop, victim: str) -> Seen:
    """One process of a graph at 100 V is killed."""
    with workshop.graph(HOLD, "--real-time") as graph:
        processes = at_the_voltage(graph)
        memory = memory_of(processes)
        when = time.time()
        graph.node(victim).send_signal(signal.SIGKILL)
        code, said = graph.wait()
        ended = time.time() - when
        status = graph.run_json()["outcome"]["status"]
        holder = "plant" if victim == "amplifier" else "amplifier"
        problem = left_behind(processes, memory) or tracebacks(graph, said)
        if f"'{victim}' died (killed by SIGKILL)" not in said:
            problem = problem or said.strip().splitlines()[-1]
        if code != 1 or status[holder]["stack_voltage_V"] != 0.0:
            problem = problem or f"exit code {code}, {status[holder]['stack_voltage_V']} V at the stack"
        bag = open_bag(graph.folder / "bag")
        if bag.complete != (victim != "recorder"):
            problem = problem or f"bag complete: {bag.complete}"
        step = np.abs(np.diff(bag.blocks(APPLIED)["voltage_V"]))
        if step.max() > LIMITS.slew_rate / RATE * (1 + 1e-9):
            problem = problem or f"a step of {step.max():.1f} V"
        seconds = ended if victim in ("amplifier", "recorder") else zero_time(graph, when)
    return Seen(problem or (RELAY if victim == "amplifier" else ENDED), seconds)


def supervisor_killed(workshop: Workshop, _rng: np.random.Generator) -> Seen:
    """Whoever started the nodes is gone, and nobody tells them to stop."""
    with workshop.graph(HOLD) as graph:
        processes = at_the_voltage(graph)
        memory = memory_of(processes)
        when = time.time()
        os.kill(graph.process.pid, signal.SIGKILL)
        wait_until(lambda: not alive(processes), "nodes of a killed supervisor are still there")
        seconds = time.time() - when
        problem = left_behind(processes, memory) or tracebacks(graph, "")
        last_words = (graph.folder / "log" / "amplifier.log").read_text(encoding="utf-8").strip().splitlines()[-1]
        if not open_bag(graph.folder / "bag").complete or "amplifier disabled" not in last_words:
            problem = problem or f"the bag is not complete, or the amplifier not at 0 V: {last_words}"
    return Seen(problem or ALONE, seconds)


def composed_killed(workshop: Workshop, _rng: np.random.Generator) -> Seen:
    """All nodes at once: there is no relay in this world that anybody could ask."""
    with workshop.graph(HOLD, "--composed") as graph:
        processes = at_the_voltage(graph)
        memory = memory_of(processes)
        when = time.time()
        graph.node("composed").send_signal(signal.SIGKILL)
        code, said = graph.wait()
        seconds = time.time() - when
        problem = left_behind(processes, memory) or tracebacks(graph, said)
        if code != 1 or "nobody is left who knows the voltage of the stack" not in said:
            problem = problem or f"exit code {code}: {said}"
        open_bag(graph.folder / "bag").blocks(APPLIED)
    return Seen(problem or NOT_CLAIMED, seconds)


def any_of_the_loop(workshop: Workshop, rng: np.random.Generator) -> Seen:
    """One of the nodes of the loop, by chance."""
    return killed(workshop, str(rng.choice(NODES_OF_THE_LOOP)))


def all_killed_and_again(workshop: Workshop, rng: np.random.Generator) -> Seen:
    """All processes of a graph in random order at random moments, and the same graph once more."""
    with workshop.graph(HOLD) as graph:
        processes = at_the_voltage(graph)
        memory = memory_of(processes)
        for process in rng.permutation(np.array(processes, dtype=object)):
            if process.is_running():
                process.send_signal(signal.SIGKILL)
            time.sleep(float(rng.exponential(0.05)))
        when = time.time()
        code, said = graph.wait()
        problem = left_behind(processes, memory) or tracebacks(graph, said)
        if code != 1:
            problem = problem or f"exit code {code}: {said}"
        domain = graph.domain
    with workshop.graph(SHORT, "--domain", str(domain)) as again:
        code, said = again.wait()
        if code != 0 or not open_bag(again.folder / "bag").complete:
            problem = problem or f"the next one: exit code {code}: {said.strip()}"
    return Seen(problem or AGAIN, time.time() - when)


def interrupted(workshop: Workshop, rng: np.random.Generator) -> Seen:
    """Ctrl-C, at any moment from the first second of the program on."""
    options = ("--composed",) if rng.random() < 0.5 else ()
    with workshop.graph(HOLD, *options) as graph:
        time.sleep(float(rng.uniform(0.5, 6.0)))
        processes = graph.nodes()
        memory = memory_of(processes)
        when = time.monotonic()
        graph.interrupt()
        code, said = graph.wait()
        seconds = time.monotonic() - when
        problem = left_behind(processes, memory) or tracebacks(graph, said)
        if code != 0 and not (code == -signal.SIGINT and not processes):
            problem = problem or f"exit code {code}: {said}"
        if "nobody is left" in said:
            problem = problem or said
    return Seen(problem or CLEAN, seconds)


def started_and_stopped(workshop: Workshop, rng: np.random.Generator) -> Seen:
    """A run from its start to its end."""
    options = ("--composed",) if rng.random() < 0.5 else ()
    with workshop.graph(SHORT, *options) as graph:
        began, processes, memory = time.monotonic(), [], set()
        while graph.process.poll() is None:
            processes = graph.nodes() or processes
            memory |= memory_of(processes)
            time.sleep(0.2)
        code, said = graph.wait()
        problem = left_behind(processes, memory) or tracebacks(graph, said)
        bag = open_bag(graph.folder / "bag")
        if code != 0 or not bag.complete or bag.blocks(APPLIED)["voltage_V"][-1] != 0.0:
            problem = problem or f"exit code {code}: {said}"
        seconds = time.monotonic() - began
    return Seen(problem or CLEAN, seconds)


# -- held up


class Holding:
    """A paced graph at 100 V that stays there, and a foreign node that hears when each block was put out."""

    def __init__(self, folder: Path) -> None:
        self._stack = contextlib.ExitStack()
        self._workshop = Workshop(folder)
        self.sent: list[float] = []

    def __enter__(self) -> Holding:
        self.graph = self._stack.enter_context(self._workshop.graph(HOLD, "--real-time"))
        self.foreign = self._stack.enter_context(ForeignNode(self.graph.domain))
        self.foreign.node.create_subscription(Float64MultiArray, APPLIED, self._on_block, QoSProfile(depth=1000))
        self.foreign.spin_until(lambda: len(self.sent) > 60)
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.graph.interrupt()
            code, said = self.graph.wait()
            assert code == 0, said
        finally:
            self._stack.close()

    def _on_block(self, _message: Float64MultiArray, info: dict[str, int]) -> None:
        self.sent.append(info["source_timestamp"] * 1e-9)

    def wait(self, seconds: float) -> None:
        """Listen for a while."""
        until = time.monotonic() + seconds
        self.foreign.spin_until(lambda: time.monotonic() > until)

    def pause_during(self, act: Callable[[], None]) -> Seen:
        """The longest time between two blocks while something is done, and a moment after."""
        self.sent = self.sent[-1:]
        act()
        self.wait(0.3)
        pause = float(np.max(np.diff([*self.sent, time.time()])))
        state = self.graph.process.poll()
        return Seen(GOES_ON if state is None else f"the graph ended with {self.graph.wait()}", pause)


def stalled(bench: Holding, seconds: float) -> Seen:
    """The controller's process stands still for a while, again and again."""
    controller = bench.graph.node("controller")

    def act() -> None:
        for _ in range(5):
            controller.suspend()
            time.sleep(seconds)
            controller.resume()
            bench.wait(0.1)

    return bench.pause_during(act)


def hogged(bench: Holding, _rng: np.random.Generator) -> Seen:
    """As many processes as there are cores do nothing but compute."""
    busy = [sys.executable, "-c", "while True: pass"]

    def act() -> None:
        hogs = [subprocess.Popen(busy) for _ in range(os.cpu_count() or 2)]
        try:
            bench.wait(3.0)
        finally:
            for hog in hogs:
                hog.kill()
                hog.wait()

    return bench.pause_during(act)


def disk_full(workshop: Workshop, _rng: np.random.Generator) -> Seen:
    """The recorder's file may not grow any more."""
    with workshop.graph(HOLD, "--real-time") as graph:
        at_the_voltage(graph)
        size = (graph.folder / "bag" / "bag_0.mcap").stat().st_size
        graph.node("recorder").rlimit(resource.RLIMIT_FSIZE, (size + 10_000, size + 10_000))
        when, log = time.monotonic(), graph.folder / "log" / "recorder.log"
        wait_until(lambda: "cannot write the bag" in log.read_text(encoding="utf-8"), "the recorder says it")
        seconds = time.monotonic() - when
        running = len(graph.nodes())
        graph.interrupt()
        code, said = graph.wait()
        status = graph.run_json()["outcome"]["status"]["recorder"]
        bag = open_bag(graph.folder / "bag")
        problem = "" if code == 0 and running == 7 else f"exit code {code}, {running} processes: {said}"
        if status["state"] != "not recording" or bag.complete or len(bag.blocks(APPLIED)) < 6000:
            problem = problem or f"recorder {status['state']}, bag complete: {bag.complete}"
    return Seen(problem or NO_MORE_BAG, seconds)


GRAPH_FAULTS = (
    Fault("kill -9: amplifier", "at 100 V", RELAY, TO_THE_END, "until the graph has ended", bench,
          lambda w, _: killed(w, "amplifier"), long=20),
    Fault("kill -9: recorder", "at 100 V", ENDED, TO_THE_END, "until the graph has ended", bench,
          lambda w, _: killed(w, "recorder"), long=20),
    Fault("kill -9: another node", "plant, sensor, observer or controller, at 100 V", ENDED,
          LIMITS.declared_safe_time, "until 0 V", bench, any_of_the_loop, long=40),
    Fault("kill -9: supervisor", "at 100 V", ALONE, TO_THE_END, "until the last node ended", bench, supervisor_killed,
          long=20),
    Fault("kill -9: composed graph", "at 100 V", NOT_CLAIMED, TO_THE_END, "until it is said", bench, composed_killed,
          long=20),
    Fault("kill -9: all, in random order", "at random moments; then the same graph in the same domain", AGAIN,
          2 * TO_THE_END, "from the last kill to the end of the next run", bench,
          all_killed_and_again, long=100),
    Fault("Ctrl-C", "from 0.5 to 6 s after the start, composed or not", CLEAN, TO_THE_END, "until the end", bench,
          interrupted, long=100),
    Fault("clean start and stop", "a run to its end, composed or not", CLEAN, 2 * TO_THE_END, "the whole run", bench,
          started_and_stopped, long=200),
    Fault("disk full", "the bag's file may not grow any more", NO_MORE_BAG, 2.0, "until it is said", bench, disk_full,
          long=20),
    *(
        Fault(f"executor stalled for {1e3 * seconds:.0f} ms", "the controller's process stands still, five times",
              GOES_ON, LIMITS.command_timeout, "longest time between two blocks", Holding,
              lambda h, _, s=seconds: stalled(h, s), long=20)
        for seconds in (1e-3, 1e-2, 1e-1)
    ),
    Fault("both cores hogged", "as many busy processes as there are cores, for 3 s", GOES_ON, LIMITS.command_timeout,
          "longest time between two blocks", Holding, hogged, long=20),
)  # fmt: skip
