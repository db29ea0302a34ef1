"""Faults that reach the amplifier node over the wire: sensor, stamps, clock, commands, senders, parameters."""

from __future__ import annotations

import math
import shutil
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from pzt_benchmarks.soak.fault import GOES_ON, LIMITED, REFUSED, SAFE, WITHIN_LIMITS, Fault, NotHereError, Seen
from pzt_benchmarks.soak.lone_amplifier import LIMITS, RATE, SIZE, Command, LoneAmplifier, Reading, as_bytes
from pzt_ros.physics.signals import Array

Harm = Callable[[LoneAmplifier, np.random.Generator], Callable[[], None] | None]
"""Does the harm; what it returns is called when the reaction has been seen."""

TO_ZERO = "until 0 V"
NEXT_BLOCK = "until the next block is put out"
PAUSE = LIMITS.command_timeout
"""What goes on pauses for no longer than the watchdog's patience [s]."""


# -- three kinds of reaction


def made_safe(bench: LoneAmplifier, rng: np.random.Generator, harm: Harm, says: str) -> Seen:
    """Harm a run that is on its way; the amplifier has to bring the stack to 0 V and say why."""
    bench.start()
    bench.run_for(float(rng.uniform(0.0, 0.2)))
    tidy_up = harm(bench, rng)
    begin = time.monotonic()
    bench.run(lambda: bench.state == "fault" and bench.voltage == 0.0, 5.0)
    seconds, found = max(bench.zero_since - begin, 0.0), bench.found()
    if tidy_up is not None:
        tidy_up()
    if found.startswith("fault at 0.0 V") and says in found:
        return Seen(SAFE, seconds)
    bench.stop()
    return Seen(found, seconds)


def taken_in_stride(bench: LoneAmplifier, rng: np.random.Generator, harm: Harm, key: str, reaction: str) -> Seen:
    """Do something once to a run that is on its way; it has to go on, and `key` to be counted where there is one."""
    bench.start()
    bench.run_for(float(rng.uniform(0.0, 0.2)))
    counted = bench.count(key)
    harm(bench, rng)
    begin, block = time.monotonic(), bench.next_block
    went_on = bench.run(lambda: bench.next_block > block + 2, 3.0)
    seconds = bench.heard - begin
    bench.run(lambda: not key or bench.count(key) > counted, 10.0)  # counters are said once a second
    bench.run_for(0.1)
    if went_on and bench.state == "enabled" and (not key or bench.count(key) > counted):
        bench.stop()
        return Seen(reaction, seconds)
    seen = Seen(f"{bench.state}, {key or 'nothing'} counted {bench.count(key) - counted} times", seconds)
    bench.stop()
    return seen


def safe(name: str, made: str, harm: Harm, says: str, bench: Any = LoneAmplifier) -> Fault:
    """A row whose reaction is the ramp to 0 V."""
    return Fault(
        name, made, SAFE, LIMITS.declared_safe_time, TO_ZERO, bench, lambda b, rng: made_safe(b, rng, harm, says)
    )


def goes_on(name: str, made: str, harm: Harm, key: str = "", reaction: str = REFUSED) -> Fault:
    """A row whose reaction is a count at most."""
    return Fault(
        name, made, reaction, PAUSE, NEXT_BLOCK, LoneAmplifier,
        lambda b, rng: taken_in_stride(b, rng, harm, key, reaction),
    )  # fmt: skip


# -- how the faults are made


def sensor(change: Callable[[Array, Array], tuple[Array, Array] | None]) -> Harm:
    """Readings are changed from now on."""

    def harm(bench: LoneAmplifier, _rng: np.random.Generator) -> None:
        bench.reading = change

    return harm


def frozen() -> Harm:
    """The reading stays what it is, to the bit."""

    def harm(bench: LoneAmplifier, _rng: np.random.Generator) -> None:
        kept: list[float] = []

        def stuck(block_time: Array, values: Array) -> tuple[Array, Array]:
            kept.append(float(values[-1]))
            return block_time, np.full(SIZE, kept[0])

        bench.reading = stuck

    return harm


def once(change: Reading) -> Harm:
    """One block of readings is changed."""

    def harm(bench: LoneAmplifier, _rng: np.random.Generator) -> None:
        honest = bench.reading

        def changed(block_time: Array, values: Array) -> tuple[Array, Array] | None:
            bench.reading = honest
            return change(block_time, values)

        bench.reading = changed

    return harm


def spoiled(block_time: Array, values: Array, value: float) -> tuple[Array, Array]:
    """One sample of a block of readings is another."""
    values = values.copy()
    values[SIZE // 2] = value
    return block_time, values


def before_the_next(bad: Callable[[Array, Array, np.random.Generator], Iterable[bytes]], instead: bool = False) -> Harm:
    """Something else is sent once before the next command, or instead of it."""

    def harm(bench: LoneAmplifier, rng: np.random.Generator) -> None:
        honest: Command = bench.command

        def changed(block_time: Array, values: Array) -> Iterable[bytes]:
            bench.command = honest
            return [*bad(block_time, values, rng), *([] if instead else honest(block_time, values))]

        bench.command = changed

    return harm


def from_now_on(change: Callable[[Array], Array]) -> Harm:
    """All commands are changed from now on."""

    def harm(bench: LoneAmplifier, _rng: np.random.Generator) -> None:
        bench.command = lambda t, v: [as_bytes(t, change(v))]

    return harm


def shifted(blocks: float) -> Harm:
    """A block whose stamps are so many blocks off."""
    return before_the_next(lambda t, v, _: [as_bytes(t + blocks * SIZE / RATE, v)])


def twice(bench: LoneAmplifier, rng: np.random.Generator) -> None:
    """Every block is sent twice, for a moment."""
    honest = bench.command
    bench.command = lambda t, v: [as_bytes(t, v), as_bytes(t, v)]
    bench.run_for(0.05)
    bench.command = honest


def with_no_number(block_time: Array, values: Array, rng: np.random.Generator) -> list[bytes]:
    """A block with one value that is no number."""
    values = values.copy()
    values[int(rng.integers(SIZE))] = rng.choice([math.nan, math.inf, -math.inf])
    return [as_bytes(block_time, values)]


def silence(bench: LoneAmplifier, _rng: np.random.Generator) -> None:
    """The sender of commands says nothing more."""
    bench.command = lambda _time, _values: []


OUT_OF_TURN = as_bytes(np.arange(SIZE) / RATE, np.zeros(SIZE))
"""The first block of a run, put out long ago."""


def flood(data: bytes) -> Harm:
    """From now on the same message ten thousand times a second, and no others."""

    def harm(bench: LoneAmplifier, rng: np.random.Generator) -> Callable[[], None]:
        over = threading.Event()

        def send() -> None:
            begin, sent = time.monotonic(), 0
            while not over.is_set():
                bench.senders["drive"].publish(data)
                sent += 1
                time.sleep(max(begin + sent * 1e-4 - time.monotonic(), 0.0))

        sender = threading.Thread(target=send)
        silence(bench, rng)
        sender.start()

        def tidy_up() -> None:
            over.set()
            sender.join()

        return tidy_up

    return harm


def second_sender(bench: LoneAmplifier, _rng: np.random.Generator) -> Callable[[], None]:
    """Somebody else announces commands."""
    node = bench.foreign.node
    other = node.create_publisher(Float64MultiArray, "/stage/drive", QoSProfile(depth=10))

    def tidy_up() -> None:
        node.destroy_publisher(other)
        bench.foreign.spin_until(lambda: bench.call("reset", Trigger)[0])

    return tidy_up


def deaf_sender(bench: LoneAmplifier, rng: np.random.Generator) -> Seen:
    """The sender is replaced by one whose QoS does not fit: DDS never connects it."""
    bench.start()
    node, honest = bench.foreign.node, bench.senders["drive"]
    node.destroy_publisher(honest)
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    bench.senders["drive"] = node.create_publisher(Float64MultiArray, "/stage/drive", best_effort)
    begin = time.monotonic()
    bench.run(lambda: bench.state == "fault" and bench.voltage == 0.0, 5.0)
    node.destroy_publisher(bench.senders["drive"])
    bench.senders["drive"] = node.create_publisher(Float64MultiArray, "/stage/drive", QoSProfile(depth=10))
    bench.foreign.spin_until(lambda: bench.senders["drive"].get_subscription_count() == 1)
    named = "incompatible QoS" in bench.log.read_text(encoding="utf-8")
    if bench.found().startswith("fault at 0.0 V: no command") and named:
        return Seen(SAFE, bench.zero_since - begin)
    return Seen(f"{bench.found()}, QoS named: {named}", bench.zero_since - begin)


def parameter(name: str, value: float) -> Harm:
    """A parameter is set out of its range while the stage moves; the node has to refuse and keep the old one."""

    def harm(bench: LoneAmplifier, _rng: np.random.Generator) -> None:
        client = bench.foreign.node.create_client(SetParameters, "/stage/amplifier/set_parameters")
        assert bench.run(client.service_is_ready), "no parameter service"
        asked = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        future = client.call_async(asked)
        assert bench.run(future.done), "no answer"
        result = future.result().results[0]
        assert not result.successful, f"{name} = {value} was accepted"
        assert result.reason, "refused without a reason"
        bench.foreign.node.destroy_client(client)

    return harm


# -- fuzzed blocks

FUZZED_AT_ONCE = 1000


def fuzzed(good: bytes, rng: np.random.Generator) -> bytes:
    """A block with a few bytes changed, cut off, or with something behind it."""
    data = bytearray(good)
    for _ in range(int(rng.integers(1, 6))):
        data[int(rng.integers(4, 120) if rng.random() < 0.7 else rng.integers(4, len(data)))] = int(rng.integers(256))
    way = rng.random()
    if way < 0.2:
        del data[int(rng.integers(4, len(data))) :]
    elif way < 0.3:
        data += rng.bytes(int(rng.integers(1, 64)))
    elif way < 0.4:
        values = rng.choice([math.nan, math.inf, 1e308, -1e308, 0.0, 500.0, 5e-324], size=4)
        struct.pack_into("<4d", data, len(data) - 8 * int(rng.integers(4, 200)), *values)
    return bytes(data)


def fuzz(bench: LoneAmplifier, rng: np.random.Generator) -> Seen:
    """A thousand broken blocks among good ones; every voltage that comes out is checked by the bench."""
    bench.start()
    left = FUZZED_AT_ONCE
    while left > 0 and bench.alive:
        if bench.state == "fault":  # one of them was read as a command that is no number
            assert bench.run(lambda: bench.voltage == 0.0, 5.0)
            bench.start()
        for _ in range(5):  # no more at once than the topic keeps
            bench.senders["drive"].publish(fuzzed(as_bytes(*bench.next_command()), rng))
            left -= 1
        bench.run_for(0.004)
    if not bench.alive:
        return Seen(f"the node died with code {bench.process.returncode}", math.nan)
    return Seen(WITHIN_LIMITS, bench.stop())


# -- clocks

_SHIM = Path(__file__).with_name("clock_jump.c")


class JumpingClock(LoneAmplifier):
    """An amplifier on `use_sim_time`, whose system clock can be set, too, by a library that is loaded before libc."""

    def __init__(self, folder: Path) -> None:
        compiler = shutil.which("cc") or shutil.which("gcc")
        if compiler is None:
            raise NotHereError("a C compiler is needed to set the clock of one process alone")
        library, self._offset = folder / "clock_jump.so", folder / "offset"
        subprocess.run([compiler, "-shared", "-fPIC", "-o", str(library), str(_SHIM), "-ldl"], check=True)
        self._offset.write_bytes(bytes(8))
        environment = {"LD_PRELOAD": str(library), "CLOCK_JUMP_FILE": str(self._offset)}
        super().__init__(folder, ("use_sim_time:=true",), environment)

    def set_clock(self, offset: int) -> None:
        """The system clock of the node is so much ahead from now on [s]."""
        with self._offset.open("r+b") as file:
            file.write(struct.pack("q", offset))


def clock_jumps(bench: JumpingClock, rng: np.random.Generator) -> None:
    """The system clock is set, forth or back by up to a day, and then the commands stop."""
    bench.set_clock(int(rng.choice([-1, 1]) * rng.integers(1, 86_400)))
    silence(bench, rng)


def sim_clock_jumps(bench: JumpingClock, rng: np.random.Generator) -> None:
    """`/clock` goes back, or far ahead, and then the commands stop."""
    sender = bench.foreign.node.create_publisher(Clock, "/clock", QoSProfile(depth=10))
    bench.foreign.spin_until(lambda: sender.get_subscription_count() > 0)
    for seconds in (1000, int(rng.integers(0, 2000))):
        said = Clock()
        said.clock.sec = seconds
        sender.publish(said)
        bench.run_for(0.05)
    silence(bench, rng)
    bench.foreign.node.destroy_publisher(sender)


# -- the rows

WIRE_FAULTS = (
    safe("sensor silent", "no more `measurement`", sensor(lambda _t, _v: None), "no measurement for"),
    safe("sensor frozen", "the same reading to the bit, while the stage is driven", frozen(), "sensor"),
    safe("sensor NaN", "one sample of a block is NaN", once(lambda t, v: spoiled(t, v, math.nan)), "finite number"),
    goes_on("sensor spike", "one sample of a block is 1 mm", once(lambda t, v: spoiled(t, v, 1e-3)), "", GOES_ON),
    safe("sensor out of range", "1 mm is added to every reading", sensor(lambda t, v: (t, v + 1e-3)), "differ by"),
    safe("measurements reversed", "their stamps are 10 s behind", sensor(lambda t, v: (t - 10.0, v)), "no measurement"),
    goes_on("stamps late", "a command for the block after the next", shifted(1.0), "refused: out of turn"),
    goes_on("stamps early", "a command for a block that was", shifted(-1.0), "refused: out of turn"),
    goes_on("stamps duplicated", "every command is sent twice for 50 ms", twice, "refused: out of turn"),
    goes_on(
        "stamps reversed",
        "the stamps within a command run backwards",
        before_the_next(lambda t, v, _: [as_bytes(t[::-1].copy(), v)]),
        "refused: out of turn",
    ),
    safe("system clock set", "forth or back by up to a day, then no more commands", clock_jumps, "", JumpingClock),
    safe("`/clock` jumps",
         "back, or far ahead, under `use_sim_time`; then no more commands", sim_clock_jumps, "",
         JumpingClock),
    safe("command NaN", "one value of a block is NaN or infinite", before_the_next(with_no_number, instead=True),
         "command voltage is not a finite number"),
    goes_on("command out of window", "commands rise to 250 V", from_now_on(lambda v: 2.0 * v),
            "limited: voltage window", LIMITED),
    goes_on("command over slew", "a block that leaps by 30 V and back, sample by sample", before_the_next(
        lambda t, v, _: [as_bytes(t, v + 30.0 * (np.arange(SIZE) % 2))], instead=True), "limited: slew rate", LIMITED),
    safe("command flood", "10 000 blocks a second, none in turn, and no others",
         flood(OUT_OF_TURN), "no command"),
    safe("flood of what is no block", "10 000 times a second the first half of a block, and nothing else",
         flood(OUT_OF_TURN[: len(OUT_OF_TURN) // 2]), "no command"),
    goes_on("wrong block shape", "a block of 99 samples",
            before_the_next(lambda t, v, _: [as_bytes(t[1:], v[1:])]), "refused: wrong block size"),
    Fault("fuzzed blocks", f"{FUZZED_AT_ONCE} blocks with bytes changed, cut or added, among good ones", WITHIN_LIMITS,
          LIMITS.declared_safe_time, "from `enable: false` to 0 V", LoneAmplifier, fuzz, long=100),
    safe("command source silent", "no more `drive`", silence, "no command for"),
    safe("two command sources", "a second publisher on `drive`", second_sender, "2 publishers"),
    Fault("QoS mismatch", "the sender of commands offers best effort where reliable is asked", SAFE,
          LIMITS.declared_safe_time, TO_ZERO, LoneAmplifier, deaf_sender),
    goes_on("parameter out of range", "`limits.voltage_max` is set to 900 V while the stage moves",
            parameter("limits.voltage_max", 900.0), reaction=GOES_ON),
    goes_on("parameter that cannot be now", "`limits.voltage_max` is set to 5 V while the stack has more",
            parameter("limits.voltage_max", 5.0), reaction=GOES_ON),
)  # fmt: skip
