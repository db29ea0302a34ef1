"""A node with the life cycle that ROS users expect of a driver: configure, activate, deactivate, cleanup, shutdown.

rclpy.lifecycle has the state machine, the services and their names; here is what the driver nodes add. A transition
out of `active` is answered only when the instrument is safe, and a service of rclpy cannot answer later; so the node
fetches the requests for `change_state` itself, on a timer.
"""

from __future__ import annotations

import time
import traceback
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn

from pzt_nodes.graph_node import GraphNode
from pzt_ros.errors import BenchError

POLL = 0.02
"""Requests are looked for this often [s]."""

_LEAVING = (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVE_SHUTDOWN)
"""Transitions that have to wait until the instrument is safe."""


class ManagedNode(LifecycleNodeMixin, GraphNode):
    """Children say what each transition does; a `BenchError` refuses it, with its line in the log.

    With the parameter `autostart` (the default) the node is active when it is made, or raises that error.
    """

    def __init__(self, name: str) -> None:
        GraphNode.__init__(self, name)
        LifecycleNodeMixin.__init__(self)
        described = ParameterDescriptor(description="configure and activate at start", read_only=True)
        self._starts_itself = bool(self.declare_parameter("autostart", True, described).value)
        self._why = ""
        self._waiting: tuple[int, Any, float] | None = None
        self._services.remove(self._service_change_state)  # not for the executor
        self.create_timer(POLL, self._serve)

    # -- what children do

    @abstractmethod
    def configure(self) -> None:
        """Open the instrument."""

    @abstractmethod
    def activate(self) -> None:
        """See that the instrument is there; from now on it is used."""

    @abstractmethod
    def unsafe(self) -> str:
        """Make the instrument safe; what is still in the way of that, or nothing."""

    @abstractmethod
    def safe_within(self) -> float:
        """How long that may take [s]."""

    @abstractmethod
    def cleanup(self) -> None:
        """Let go of the instrument."""

    # -- the state

    @property
    def life(self) -> str:
        """unconfigured, inactive, active or finalized."""
        return str(self._state_machine.current_state[1])

    @property
    def is_open(self) -> bool:
        """Whether the instrument is open."""
        return self.life in ("inactive", "active")

    @property
    def inactive(self) -> str:
        """Why the instrument is not to be used now; empty where it is."""
        if self.life != "active":
            return f"the {self.role} is {self.life}; activate it first"
        return "the node is being deactivated" if self._waiting is not None else ""

    def start(self) -> None:
        """Configure and activate, unless somebody else is to do it.

        Raises:
            BenchError: the instrument does not allow it.
        """
        steps = (self.trigger_configure, self.trigger_activate) if self._starts_itself else ()
        for step in steps:
            if step() != TransitionCallbackReturn.SUCCESS:
                raise BenchError(self._why)

    # -- transitions; names and arguments are rclpy's

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Unconfigured to inactive."""
        return self._attempt(self.configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive to active."""
        return self._attempt(self.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Active to inactive; the instrument is safe already."""
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive to unconfigured."""
        return self._attempt(self.cleanup)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """To finalized, from anywhere."""
        return self._attempt(self.cleanup)

    def _attempt(self, step: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            step()
        except BenchError as error:
            self._why = str(error)
            return TransitionCallbackReturn.FAILURE
        except Exception as error:  # rclpy takes it as an error of the node, and says nothing
            self._why = f"{type(error).__name__}: {error}"
            self.get_logger().error(traceback.format_exc())
            raise
        return TransitionCallbackReturn.SUCCESS

    # -- requests

    def _serve(self) -> None:
        """Take in the next request, or go on with the one that waits."""
        if self._waiting is None:
            service = self._service_change_state
            with service.handle:
                request, header = service.handle.service_take_request(ChangeState.Request)
            if header is None:
                return
            transition = self._allowed(request.transition)
            self._waiting = transition, header, time.monotonic() + self.safe_within()
        transition, header, deadline = self._waiting
        self._why = ""
        if transition in _LEAVING and (waits := self.unsafe()):
            if time.monotonic() < deadline:
                return
            self._why, transition = waits, 0
        self._waiting = None
        self._answer(header, self._change(transition))

    def _allowed(self, wanted: Transition) -> int:
        """The transition that is meant, by its name or its number; 0 where this state does not have it."""
        for number, label, *_ in self._state_machine.available_transitions:
            if label == wanted.label or (not wanted.label and number == wanted.id):
                return int(number)
        return 0

    def _change(self, transition: int) -> bool:
        steps = {
            Transition.TRANSITION_CONFIGURE: self.trigger_configure,
            Transition.TRANSITION_ACTIVATE: self.trigger_activate,
            Transition.TRANSITION_DEACTIVATE: self.trigger_deactivate,
            Transition.TRANSITION_CLEANUP: self.trigger_cleanup,
            Transition.TRANSITION_UNCONFIGURED_SHUTDOWN: self.trigger_shutdown,
            Transition.TRANSITION_INACTIVE_SHUTDOWN: self.trigger_shutdown,
            Transition.TRANSITION_ACTIVE_SHUTDOWN: self.trigger_shutdown,
        }
        if transition not in steps:
            self._why = self._why or f"the node is {self.life}, which has no such transition"
            return False
        return bool(steps[transition]() == TransitionCallbackReturn.SUCCESS)

    def _answer(self, header: Any, success: bool) -> None:
        if success:
            self.get_logger().info(f"{self.role} {self.life}")
        else:
            self.get_logger().error(f"transition refused: {self._why}")
        self._service_change_state.send_response(ChangeState.Response(success=success), header)
        self._report()

    def health(self) -> tuple[str, str, dict[str, object]]:
        """Adds the state of the life cycle."""
        level, text, values = super().health()
        return level, text, {**values, "life": self.life}

    def close(self) -> None:
        """Give the service back, so that it is destroyed with the node, and the machine, which rclpy forgets."""
        self._services.append(self._service_change_state)
        self._state_machine.destroy_when_not_in_use()
