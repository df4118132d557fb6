"""How finely large clouds are drawn."""

from __future__ import annotations

from pseudolidar.viewer.drawn_octrees import DrawnOctrees
from pseudolidar.viewer.view import View

# Points at a time that one may choose from, millions.
LEAST_M, MOST_M, STEP_M = 0.5, 8.0, 0.5
HINT = (
    "{points:.1f} million points: each browser draws as many as it can, the near ones finely. "
    "Fewer are faster."
)


class DetailPanel:
    """A slider, where there are large clouds.

    Args:
        view: what is looked at.
        octrees: draws them.
    """

    def __init__(self, view: View, octrees: DrawnOctrees) -> None:
        if not octrees.points:
            return
        with view.gui.add_folder("Large clouds"):
            budget = view.gui.add_slider(
                "Millions drawn", min=LEAST_M, max=MOST_M, step=STEP_M,
                initial_value=octrees.budget / 1e6,
            )  # fmt: skip
            view.gui.add_markdown(HINT.format(points=octrees.points / 1e6))

        def limit(_: object) -> None:
            octrees.budget = int(budget.value * 1e6)
            octrees.wake()

        budget.on_update(limit)
