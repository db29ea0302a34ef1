"""Messages and requests between the nodes of one process, handed over without DDS.

DDS delivers within a process, too, but what it does for it (a copy, a lock, an event and a turn of the executor for
every reader) took longer in a tick of 20 samples than all the physics. Other processes are reached by DDS as before.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable
from typing import Any

from rclpy.task import Future

from pzt_nodes.turns import Turns

AT_ONCE = 64
"""Deliveries in one turn of the executor: some ticks; then signals, timers and foreign messages have their turn."""

Deliver = Callable[[Any], None]


class IntraProcess:
    """What is said on a topic is given to its readers here, in order, in turns of the executor.

    A topic or a service is known by its full name. Readers are served in the order of listening.
    """

    def __init__(self, turns: Turns) -> None:
        self._turns = turns
        self._readers: dict[str, list[Deliver]] = defaultdict(list)
        self._services: dict[str, tuple[Any, Callable[[Any, Any], Any]]] = {}
        self._waiting: deque[tuple[Deliver, Any]] = deque()
        self._has_turn = False

    def listen(self, topic: str, callback: Deliver) -> None:
        """Call `callback` with everything that is said here on a topic."""
        self._readers[topic].append(callback)

    def readers(self, topic: str) -> int:
        """How many listen here."""
        return len(self._readers[topic])

    def say(self, topic: str, message: Any) -> None:
        """Give a message to all who listen here."""
        self._waiting.extend((callback, message) for callback in self._readers[topic])
        self._ask_for_turn()

    def offer(self, service: str, kind: Any, callback: Callable[[Any, Any], Any]) -> None:
        """Answer requests by `callback(request, response)`."""
        self._services[service] = kind, callback

    def offers(self, service: str) -> bool:
        """Whether somebody here answers requests to a service."""
        return service in self._services

    def ask(self, service: str, request: Any) -> Future:
        """Make a request that is answered in one of the next turns."""
        kind, callback = self._services[service]
        future = Future()
        self._waiting.append((lambda asked: future.set_result(callback(asked, kind.Response())), request))
        self._ask_for_turn()
        return future

    def _ask_for_turn(self) -> None:
        if self._waiting and not self._has_turn:
            self._has_turn = True
            self._turns.take(self._deliver)

    def _deliver(self) -> None:
        for _ in range(AT_ONCE):
            if not self._waiting:
                break
            callback, message = self._waiting.popleft()
            callback(message)
        self._has_turn = False
        self._ask_for_turn()


class IntraProcessPublisher:
    """A publisher whose messages reach the readers here directly, and all others by DDS."""

    def __init__(self, publisher: Any, here: IntraProcess) -> None:
        self._publisher = publisher
        self._here = here
        self._topic = publisher.topic_name

    def publish(self, message: Any) -> None:
        """Say it."""
        self._here.say(self._topic, message)
        self._publisher.publish(message)

    def get_subscription_count(self) -> int:
        """Readers here and elsewhere."""
        return int(self._publisher.get_subscription_count()) + self._here.readers(self._topic)

    def wait_for_all_acked(self, timeout: Any) -> bool:
        """Whether all others have all that was said."""
        return bool(self._publisher.wait_for_all_acked(timeout))


class IntraProcessClient:
    """A client that asks here where the service is offered here, and elsewhere otherwise."""

    def __init__(self, client: Any, service: str, here: IntraProcess) -> None:
        self._client = client
        self._service = service
        self._here = here

    def service_is_ready(self) -> bool:
        """Whether a request would be heard."""
        return self._here.offers(self._service) or bool(self._client.service_is_ready())

    def call_async(self, request: Any) -> Future:
        """Make a request."""
        if self._here.offers(self._service):
            return self._here.ask(self._service, request)
        return self._client.call_async(request)
