"""GCS drivers against a simulated controller on a real socket: what they say, and what happens when it misbehaves."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from gcs_server import CLOSE, DRIBBLE, ENDLESS, SILENT, GcsServer, Trouble

from pzt_ros.chains import load_chain
from pzt_ros.errors import BenchError
from pzt_ros.hardware.driver import Bench, DriverError
from pzt_ros.hardware.gcs import GcsConnection
from pzt_ros.hardware.gcs_drivers import GcsAmplifier, GcsAmplifierSettings, GcsSensor, GcsSensorSettings
from pzt_ros.hardware.guard import DISABLED, ENABLED, FAULT, RAMPING, GuardedAmplifier, Limits
from pzt_ros.physics.signals import Rest
from pzt_ros.reference import block_times

pytestmark = pytest.mark.timeout(30)

RATE, SIZE = 2000.0, 5
LIMITS = Limits(voltage_min=-20.0, voltage_max=120.0, slew_rate=2e4, safe_rate=5e3)
STEP = LIMITS.slew_rate / RATE
"""Largest change of the command from sample to sample [V]."""
TIMEOUT = 0.1


@pytest.fixture
def server() -> Iterator[GcsServer]:
    with GcsServer() as running:
        yield running


def bench() -> Bench:
    return Bench(load_chain("thesis-p2"), Rest(), RATE, SIZE)


def amplifier(server: GcsServer, **settings: object) -> GcsAmplifier:
    given = {"host": "127.0.0.1", "port": float(server.port), "timeout": TIMEOUT, "closing_rate": 5e4, **settings}
    driver = GcsAmplifierSettings(**given).build(bench())  # type: ignore[arg-type]
    driver._connection._retry_after = 0.0  # these tests do not want to wait
    return driver


def sensor(server: GcsServer, **settings: object) -> GcsSensor:
    given = {"host": "127.0.0.1", "port": float(server.port), "timeout": TIMEOUT, **settings}
    driver = GcsSensorSettings(**given).build(bench())  # type: ignore[arg-type]
    driver._connection._retry_after = 0.0
    return driver


def until(happened: Callable[[], bool]) -> None:
    """Wait for another thread."""
    deadline = time.monotonic() + 20.0
    while not happened():
        assert time.monotonic() < deadline, "waited 20 s in vain"
        time.sleep(0.001)


def one_line(error: BaseException) -> str:
    text = str(error)
    assert text
    assert "\n" not in text
    return text


# -- the protocol


class Script:
    """A server that accepts once and plays its part: bytes to send for each packet it receives."""

    def __init__(self, *parts: bytes) -> None:
        self._parts = parts

    def __call__(self, connection: socket.socket) -> None:
        for part in self._parts:
            connection.recv(4096)
            for byte in part:  # one packet each
                connection.sendall(bytes([byte]))


@pytest.fixture
def connect() -> Iterator[Callable[[Script], GcsConnection]]:
    opened: list[tuple[GcsConnection, socket.socket, threading.Thread]] = []

    def make(script: Script) -> GcsConnection:
        listener = socket.create_server(("127.0.0.1", 0))

        def serve() -> None:
            connection, _ = listener.accept()
            with connection, contextlib.suppress(ConnectionError):
                script(connection)
                connection.recv(1)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        connection = GcsConnection("127.0.0.1", listener.getsockname()[1], TIMEOUT)
        opened.append((connection, listener, thread))
        return connection

    yield make
    for connection, listener, thread in opened:
        connection.close()
        listener.close()
        thread.join(5.0)
        assert not thread.is_alive()


def test_an_answer_ends_with_the_first_line_without_a_space(connect: Callable[[Script], GcsConnection]) -> None:
    connection = connect(Script(b"1=1.5 \n2=-2.5e+01 \n3=0\n", b"0\n1=7\n"))
    assert connection.exchange("POS?") == [["1=1.5", "2=-2.5e+01", "3=0"]]
    assert connection.exchange("SVA 1 7", "ERR?", "VOL? 1") == [["0"], ["1=7"]]


def test_number_wants_just_one_of_the_item_asked_for(connect: Callable[[Script], GcsConnection]) -> None:
    assert connect(Script(b"1=-8.45709419e+01\n")).number("POS?", "1") == -84.5709419
    for answer in (b"2=1.0\n", b"1=\n", b"1.0\n", b"1=nan\n", b"1=inf\n", b"1=1,5\n", b"\n", b"1=1 \n2=2\n"):
        with pytest.raises(DriverError, match="expected '1=' and a number") as caught:
            connect(Script(answer)).number("POS?", "1")
        one_line(caught.value)


def test_what_comes_unasked_is_not_taken_for_an_answer(connect: Callable[[Script], GcsConnection]) -> None:
    connection = connect(Script(b"1=5\n1=6\n"))
    connection.exchange("POS? 1")
    until(lambda: connection._received != b"" or _arrived(connection))
    with pytest.raises(DriverError, match="unasked"):
        connection.exchange("POS? 1")
    assert not connection.connected


def test_random_answers_are_a_number_or_one_line(server: GcsServer) -> None:
    rng = np.random.default_rng(7)
    connection = GcsConnection("127.0.0.1", server.port, 0.02, retry_after=0.0)
    alphabet = b"1=.-+e0123456789 \n\r\x00\xffnaif"
    outcomes = {"number": 0, "error": 0}
    for case in range(300):
        answer = bytes(rng.choice(list(alphabet), size=int(rng.integers(0, 12))).astype(np.uint8))
        server.trouble["VOL?"] = b"1=" * int(rng.integers(0, 2)) + answer + b"\n" * (case % 8 != 0)
        try:
            assert np.isfinite(connection.number("VOL?", "1"))
            outcomes["number"] += 1
        except DriverError as error:
            one_line(error)
            outcomes["error"] += 1
    assert min(outcomes.values()) > 10, outcomes
    connection.close()


def _arrived(connection: GcsConnection) -> bool:
    assert connection._socket is not None
    return bool(connection._socket.recv(16, socket.MSG_PEEK))


def test_nobody_there_is_said_in_one_line_and_not_tried_again_at_once() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    connection = GcsConnection("127.0.0.1", port, TIMEOUT, retry_after=60.0)
    with pytest.raises(DriverError, match=r"cannot be reached \(Connection refused\)"):
        connection.connect()
    with pytest.raises(DriverError, match="trying again in") as caught:
        connection.connect()
    one_line(caught.value)


# -- the amplifier


def test_open_moves_nothing_and_tells_what_it_found() -> None:
    with GcsServer(voltage=42.0) as server:
        driver = amplifier(server)
        driver.open()
        assert driver.voltage == pytest.approx(42.0)
        assert server.history == [42.0]
        assert not server.servo, "open loop"
        assert "42.00 V at the stack; controller limits -30 to 130 V; current is not measured" in driver.remark
        driver.close()


def test_a_controller_that_does_not_tell_its_limits_will_do() -> None:
    with GcsServer(knows_limits=False) as server:
        driver = amplifier(server)
        driver.open()
        assert "controller limits unknown to unknown V" in driver.remark
        driver.close()


def test_samples_go_out_in_order_and_come_back_as_read(server: GcsServer) -> None:
    driver = amplifier(server, capacitance=1e-6, volts_per_unit=10.0)
    driver.open()
    assert driver.gain == 10.0
    server.history.clear()
    command = np.array([0.1, 0.2, 0.4, 0.4, 0.3])
    began = time.monotonic()
    driver._settings = GcsAmplifierSettings(**{**vars(driver._settings), "tolerance": 1e3})
    applied = driver.apply(block_times(0, SIZE, RATE), command)
    assert time.monotonic() - began >= (SIZE - 1) / RATE, "not faster than their times"
    np.testing.assert_allclose(server.history, command, atol=1e-6)
    np.testing.assert_allclose(applied.voltage, command, atol=1e-6)  # VOL? is in volts already
    np.testing.assert_allclose(applied.charge, 1e-6 * command, atol=1e-12)
    np.testing.assert_allclose(applied.current, 1e-6 * np.diff(command, prepend=0.0) * RATE, atol=1e-9)
    driver.close()


def test_lateness_is_made_up_slowly_or_not_at_all(server: GcsServer) -> None:
    driver = amplifier(server)
    period = 1.0 / RATE
    driver._due = 10.0
    assert driver._next_due(10.0) == pytest.approx(10.0 + period), "on time"
    assert driver._next_due(10.0 + 0.05 * period) == pytest.approx(10.0 + period), "a little late: made up"
    assert driver._next_due(10.0 + 3.0 * period) == pytest.approx(10.0 + 3.9 * period), "a tenth of a period sooner"
    assert driver._next_due(10.0 + 6.0 * period) == pytest.approx(10.0 + 7.0 * period), "not made up"


def test_close_brings_the_stack_to_zero_in_steps_and_may_be_called_again() -> None:
    with GcsServer(voltage=100.0) as server:
        driver = amplifier(server, closing_rate=2e3)
        driver.open()
        driver.close()
        assert server.voltage == 0.0
        steps = -np.diff(server.history)
        assert steps.min() >= 0.0
        assert steps.max() == pytest.approx(20.0)
        assert driver.voltage == 0.0
        driver.close()
        with pytest.raises(DriverError, match="not connected"):
            driver.apply(block_times(0, SIZE, RATE), np.zeros(SIZE))


def test_opened_again_it_keeps_its_own_pace_and_not_that_of_coming_down(server: GcsServer) -> None:
    driver = amplifier(server, capacitance=1e-6)
    driver._connection._retry_after = 60.0  # of its own accord it would not try again for a minute
    for _ in range(2):
        driver.open()
        applied = driver.apply(block_times(0, SIZE, RATE), np.linspace(1.0, SIZE, SIZE))
        np.testing.assert_allclose(applied.current, 1e-6 * 1.0 * RATE, rtol=1e-4)
        driver.close()
    assert server.voltage == 0.0


def test_close_does_not_raise_when_the_controller_is_gone() -> None:
    with GcsServer(voltage=50.0) as server:
        driver = amplifier(server)
        driver.open()
        server.trouble["SVA"] = server.trouble["ERR?"] = CLOSE
        driver.close()
    assert "closed with 50.00 V at the stack: controller 127.0.0.1" in driver.remark


TROUBLES: dict[str, tuple[Trouble, str]] = {
    "silent": (SILENT, "gave no complete answer to"),
    "closes the socket": (CLOSE, r"closed the connection before it answered|broke off before it answered"),
    "dribbles without end": (DRIBBLE, "gave no complete answer to"),
    "talks without end": (ENDLESS, "answers '.*' without end"),
    "garbage": (b"\x00\xff\xfe garbage \x80\n", "which is no text"),
    "text for a number": (b"one\n", "expected"),
    "empty line": (b"\n", "expected"),
}


@pytest.mark.parametrize("word", ["*IDN?", "ERR?", "VOL?"])
@pytest.mark.parametrize("trouble", TROUBLES)
def test_trouble_at_opening_is_one_line(server: GcsServer, word: str, trouble: str) -> None:
    server.trouble[word], expected = TROUBLES[trouble]
    if word == "*IDN?" and trouble in ("text for a number", "empty line"):
        expected = "is no PI controller, it says"
    driver = amplifier(server)
    with pytest.raises(DriverError, match=expected) as caught:
        driver.open()
    one_line(caught.value)
    driver.close()


def test_another_instrument_is_not_taken_for_a_controller(server: GcsServer) -> None:
    server.trouble["*IDN?"] = b"KEITHLEY INSTRUMENTS,MODEL 2000\n"
    with pytest.raises(DriverError, match="is no PI controller, it says 'KEITHLEY"):
        amplifier(server).open()
    assert server.history == [0.0]


def test_an_axis_that_is_not_there_is_named_and_the_connection_not_used(server: GcsServer) -> None:
    driver = amplifier(server, axis="2")
    for _ in range(2):
        with pytest.raises(DriverError, match="refused 'SVO 2 0' with error 15: there is no such axis"):
            driver.open()
        assert not driver._connection.connected
    with pytest.raises(DriverError, match="error 15"):
        _ = driver.voltage
    assert server.servo, "nothing was switched"
    driver.close()


def test_no_address_is_said() -> None:
    with pytest.raises(BenchError, match=r"set the parameter gcs\.host"):
        GcsAmplifierSettings().build(bench())
    with pytest.raises(BenchError, match=r"set the parameter gcs\.host"):
        GcsSensorSettings().build(bench())


def test_an_error_of_the_controller_is_named(server: GcsServer) -> None:
    driver = amplifier(server)
    driver.open()
    with pytest.raises(DriverError, match="error 302: the voltage is outside the controller's limits") as caught:
        driver.apply(block_times(0, SIZE, RATE), np.full(SIZE, 140.0))
    one_line(caught.value)
    assert driver._connection.connected, "a refusal is a proper answer"
    driver.close()


# -- behind the guard


def guarded(driver: GcsAmplifier) -> GuardedAmplifier:
    driver.open()
    return GuardedAmplifier(driver, LIMITS, RATE, SIZE)


def command(guard: GuardedAmplifier, voltage: float) -> bool:
    block = np.full(SIZE, voltage)
    return guard.apply(guard.next_block * SIZE / RATE, block) is not None


def ramp_down(guard: GuardedAmplifier) -> None:
    for _ in range(1000):
        if guard.state != RAMPING:
            return
        guard.ramp()
    pytest.fail("the ramp does not end")


def assert_inside(history: list[float]) -> None:
    assert min(history) >= LIMITS.voltage_min
    assert max(history) <= LIMITS.voltage_max
    assert np.max(np.abs(np.diff(history))) <= STEP + 1e-5


def test_enabling_a_charged_stack_does_not_make_it_jump() -> None:
    with GcsServer(voltage=80.0) as server:
        guard = guarded(amplifier(server))
        assert guard.enable() == ""
        guard.hold()
        assert server.history == pytest.approx([80.0] * (SIZE + 1))
        command(guard, 0.0)
        assert_inside(server.history)
        guard.driver.close()


IN_A_RUN = [
    (word, trouble) for word in ("SVA", "ERR?", "VOL?") for trouble in TROUBLES if word != "SVA" or trouble != "silent"
]
"""A command is answered by nothing anyway: that SVA stays silent is no trouble, that nothing happens is one, below."""


@pytest.mark.parametrize(("word", "trouble"), IN_A_RUN)
def test_trouble_in_a_run_is_a_fault_and_ends_at_zero(server: GcsServer, word: str, trouble: str) -> None:
    guard = guarded(amplifier(server))
    assert guard.enable() == ""
    for _ in range(4):
        assert command(guard, 100.0)
    assert guard.stack_voltage == pytest.approx(100.0)
    server.trouble[word] = TROUBLES[trouble][0]
    assert not command(guard, 110.0)
    assert guard.state == RAMPING
    one_line(Exception(guard.reason))
    assert guard.ramp() is None, "as long as it lasts, nothing can be done"
    assert np.isnan(guard.stack_voltage) or guard.stack_voltage <= 110.0
    highest = max(server.history)
    before = len(server.history)
    server.trouble.clear()
    server.hang_up()
    ramp_down(guard)
    assert guard.state == FAULT
    assert server.voltage == 0.0
    assert_inside(server.history)
    assert max(server.history[before - 1 :]) <= highest
    assert np.all(np.diff(server.history[before - 1 :]) <= 1e-5), "no rise after the fault"
    assert guard.reset() == ""
    assert guard.state == DISABLED
    guard.driver.close()


def test_a_controller_that_was_off_and_on_is_not_driven_up_again(server: GcsServer) -> None:
    guard = guarded(amplifier(server))
    guard.enable()
    for _ in range(4):
        command(guard, 100.0)
    server.power_cycle()
    assert not command(guard, 100.0)
    count = len(server.history)
    ramp_down(guard)
    assert guard.state == FAULT
    assert set(server.history[count:]) <= {0.0}
    guard.driver.close()


def test_a_stack_that_does_not_follow_is_a_fault(server: GcsServer) -> None:
    guard = guarded(amplifier(server))
    guard.enable()
    server.trouble["SVA"] = SILENT  # accepted, and nothing happens
    for _ in range(3):
        command(guard, 100.0)
    assert guard.state == RAMPING
    assert "check volts_per_unit, the channel and the stack" in guard.reason
    ramp_down(guard)
    assert guard.state == FAULT
    guard.driver.close()


def test_a_readback_that_is_too_high_does_not_raise_the_voltage(server: GcsServer) -> None:
    guard = guarded(amplifier(server))
    guard.enable()
    command(guard, 20.0)
    server.trouble["VOL?"] = b"1=120\n"
    command(guard, 20.0)
    assert guard.state == RAMPING
    for _ in range(10):
        guard.ramp()
    assert max(server.history) <= 20.0 + STEP * SIZE + 1e-5, "no more than one block can have added"
    guard.driver.close()


# -- the sensor


def test_the_sensor_reads_what_the_stage_does(server: GcsServer) -> None:
    drive, reading = amplifier(server), sensor(server)
    drive.open()
    reading.open()
    guard = GuardedAmplifier(drive, LIMITS, RATE, SIZE)
    guard.enable()
    for _ in range(10):
        command(guard, 100.0)
    seen = len(server.said)
    until(lambda: sum(word.startswith("POS?") for word in server.said[seen:]) > 1)
    time_s = block_times(9, SIZE, RATE)
    got = reading.read(time_s, time_s)
    assert got.shape == (SIZE,)
    assert got[-1] == pytest.approx(1e-6 * server.position)
    assert server.position > 0.1
    assert guard.state == ENABLED
    reading.close()
    drive.close()


@pytest.mark.parametrize("trouble", TROUBLES)
def test_a_sensor_in_trouble_says_so_and_comes_back(server: GcsServer, trouble: str) -> None:
    reading = sensor(server, oldest=0.02)
    reading.open()
    server.trouble["POS?"] = TROUBLES[trouble][0]
    times = block_times(0, SIZE, RATE)
    caught: list[BenchError] = []

    def fails() -> bool:
        try:
            reading.read(times, times)
        except BenchError as error:
            caught.append(error)
        return any("limit 0.02 s" in str(error) and reading._trouble for error in caught)

    until(fails)
    one_line(caught[-1])
    server.trouble.clear()
    server.hang_up()

    def reads() -> bool:
        try:
            return bool(np.all(np.isfinite(reading.read(times, times))))
        except BenchError:
            return False

    until(reads)
    reading.close()
    reading.close()
    with pytest.raises(DriverError, match="open the driver first"):
        reading.read(times, times)
