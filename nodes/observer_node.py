"""The hysteresis observer: the model run on `applied`, pulled towards `measurement`; says `estimate`."""

from __future__ import annotations

from typing import Any

from rclpy.parameter import Parameter

from pzt_nodes.graph_node import GraphNode
from pzt_nodes.join import Join
from pzt_nodes.parameters import changed, declare_all, declare_text, on_change
from pzt_nodes.spin import main as run_node
from pzt_ros.blocks import Block
from pzt_ros.observers.table import OBSERVERS, find_observer


class ObserverNode(GraphNode):
    """One observer, chosen by parameter; its gains are parameters and may change while it runs."""

    def __init__(self) -> None:
        super().__init__("observer")
        self.model = self.load_model()
        kind = declare_text(self, "observer", "disturbance", f"one of {', '.join(OBSERVERS)}")
        self.observer = declare_all(self, kind, find_observer(kind)())
        self._state = self.observer.init(self.model, self.rest)
        self.observer.warm_up(self.model, self._state)
        self._join = Join(("predicted", "measurement"), self._on_tick)
        self.listen("applied", self._on_applied)
        self.listen("measurement", lambda block: self._join.add(self.tick_of(block), "measurement", block))
        on_change(self, self._on_parameters)

    def _on_applied(self, block: Block) -> None:
        """The model runs while the block is still being measured."""
        self._state, predicted = self.observer.predict(
            self.model, self._state, block.time, block["voltage_V"], block["charge_C"]
        )
        self._join.add(self.tick_of(block), "predicted", predicted)

    def _on_tick(self, _tick: int, parts: dict[str, Any]) -> None:
        self.ticks += 1
        self._state, e = self.observer.correct(self._state, parts["predicted"], parts["measurement"]["displacement_m"])
        bands = (e.displacement_std, e.polarization_std, e.phase_fraction_std) if e.displacement_std.size else ()
        found = (e.displacement, e.polarization, e.phase_fraction, e.innovation, e.disturbance)
        self.publish("estimate", e.time, *found, *bands)

    def health(self) -> tuple[str, str, dict[str, object]]:
        """What the observer has to say of its readings."""
        level, text, values = super().health()
        return level, text, {**values, **self.observer.health(self._state)}

    def _on_parameters(self, parameters: list[Parameter]) -> str:
        self.observer = changed(self.observer, self.observer.kind, parameters)
        return ""


def main() -> None:
    """Run the observer node."""
    run_node(ObserverNode)


if __name__ == "__main__":
    main()
