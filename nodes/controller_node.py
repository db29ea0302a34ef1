"""The controller: from reference, measurement and estimate to `drive`; its answer closes the tick."""

from __future__ import annotations

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.parameter import Parameter

from pzt_nodes.graph_node import GraphNode
from pzt_nodes.join import Join
from pzt_nodes.messages import float_message
from pzt_nodes.parameters import changed, declare_all, on_change
from pzt_nodes.spin import main as run_node
from pzt_ros.blocks import Block
from pzt_ros.controllers.bounds import Bounds
from pzt_ros.controllers.controller import Feedback
from pzt_ros.controllers.loop import ControlLoop
from pzt_ros.controllers.table import CONTROLLERS
from pzt_ros.reference import DISPLACEMENT, VOLTAGE, Reference


class ControllerNode(GraphNode):
    """All controllers of the table; the parameter `controller` says which is in charge, and may be set in a run."""

    def __init__(self) -> None:
        super().__init__("controller")
        model = self.load_model()
        described = ParameterDescriptor(description=f"controller in charge: one of {', '.join(CONTROLLERS)}")
        active = str(self.declare_parameter("controller", "open_loop", described).value)
        controllers = {name: declare_all(self, name, cls()) for name, cls in CONTROLLERS.items()}
        bounds = declare_all(self, "limits", Bounds(), read_only=True)
        self.loop = ControlLoop(model, controllers, self.rest, active, self.timing.handover_time, bounds)
        self.loop.warm_up()
        self._join = Join(("reference", "applied", "measurement", "estimate"), self._on_tick)
        self._asked: Reference | None = None
        self.listen("applied", self._on_applied)
        for name in ("measurement", "estimate"):
            self.listen(name, lambda block, name=name: self._join.add(self.tick_of(block), name, block))
        self.listen("reference", lambda block: self._on_reference(DISPLACEMENT, block, "displacement_m"))
        self.listen("voltage_reference", lambda block: self._on_reference(VOLTAGE, block, "voltage_V"))
        on_change(self, self._on_parameters)

    def _on_applied(self, block: Block) -> None:
        """The model follows while the block is still being measured."""
        self.loop.follow(block.time, block["voltage_V"])
        self._join.add(self.tick_of(block), "applied", block)

    def _on_reference(self, quantity: str, block: Block, column: str) -> None:
        # The reference of the block to come belongs to the tick of the block that was measured before it.
        self._join.add(self.tick_of(block) - 1, "reference", Reference(quantity, block.time, block[column]))

    def _on_tick(self, _tick: int, parts: dict[str, Block]) -> None:
        self.ticks += 1
        reference: Reference = parts["reference"]  # type: ignore[assignment]
        measured = parts["measurement"]
        feedback = Feedback(
            measured.time,
            parts["applied"]["voltage_V"],
            measured["displacement_m"],
            parts["estimate"]["displacement_m"],
        )
        command = self.loop.step(reference, feedback)
        self.publish("drive", reference.time, command)
        self._show_error(measured)
        self._asked = reference

    def _show_error(self, measured: Block) -> None:
        if self._asked is not None and self._asked.quantity == DISPLACEMENT:
            error = self._asked.values[-1] - measured["displacement_m"][-1]
            self.plot("tracking_error", float(measured.time[-1]), lambda: float_message(error))

    def _on_parameters(self, parameters: list[Parameter]) -> str:
        for parameter in parameters:
            if parameter.name == "controller":
                if parameter.value not in CONTROLLERS:
                    return f"controller '{parameter.value}' is unknown; known are {', '.join(CONTROLLERS)}"
                self.loop.select(parameter.value)
        for name, controller in list(self.loop.controllers.items()):
            self.loop.replace(changed(controller, name, parameters))
        return ""

    def health(self) -> tuple[str, str, dict[str, object]]:
        """Which controller is in charge."""
        level, text, values = super().health()
        return level, text, {**values, **self.loop.health()}


def main() -> None:
    """Run the controller node."""
    run_node(ControllerNode)


if __name__ == "__main__":
    main()
