"""Whether a step that vision found is true: asked of the pictures again, and of the map.

Another step is found from where the camera would go on to. Vision is wrong where the pictures, laid
over each other by its step, disagree far more than by the other one, and the map does not speak
against it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pseudolidar.geometry.twists import inverted, log_twist
from pseudolidar.mapping.second_look import SecondLook
from pseudolidar.mapping.steps_apart import apart
from pseudolidar.structures.arrays import Float64

# How far predictions may be off: one standard deviation, m and rad.
PREDICTED_M, PREDICTED_RAD = 0.3, 0.03
# Disagreement of pictures by a wrong step over that by the right one: 1.9 and more by 66 wrong
# steps; right ones measured beside stay below 1.1 (tests/benchmarks/integrity.py, 2026-11).
WORSE = 1.4
# The map may speak against the other step by so much of its score; where pictures show nothing it
# must speak for it by so much.
MAP_AGAINST, MAP_FOR = 0.02, 0.02

Witness = Literal["none", "pictures", "map", "scans"]


@dataclass(frozen=True, eq=False)
class StepCheck:
    """What witnesses say of a step.

    Args:
        asked: who was asked; `none` where the step is as predicted, or nothing was predicted;
            `scans` where the frame's scan overruled it.
        wrong: whether the step is not true.
        T_from_to: (4, 4) the step to go on with.
        apart_m: how far the other step is from vision's.
        apart_rad: how much it is turned.
        vision_agrees: mean agreement of what was asked with vision's step, 0-1.
        other_agrees: with the other.
    """

    asked: Witness
    wrong: bool
    T_from_to: Float64
    apart_m: float = 0.0
    apart_rad: float = 0.0
    vision_agrees: float = float("nan")
    other_agrees: float = float("nan")


def checked(
    step: Float64,
    predicted: Float64 | None,
    look: SecondLook,
    map_score: Callable[[Float64], float],
) -> StepCheck:
    """Ask about a step.

    Args:
        step: (4, 4) `T_from_to` that vision found.
        predicted: (4, 4) what it would be if the sensor went on as before; None where unknown.
        look: the pictures at both ends.
        map_score: agreement of the map with a step, 0-1.
    """
    if predicted is None or not apart(step, predicted):
        return StepCheck("none", False, step)
    if not look.sees:
        of_vision, of_other = map_score(step), map_score(predicted)
        wrong = of_other > of_vision + MAP_FOR
        return step_check("map", wrong, step, predicted, of_vision, of_other)
    information = np.diag(np.repeat([PREDICTED_M**-2.0, PREDICTED_RAD**-2.0], 3))
    other = look.best(predicted, information)
    of_vision, of_other = look.agreement(step), look.agreement(other)
    wrong = apart(step, other) and 1.0 - of_vision > WORSE * (1.0 - of_other)
    wrong = wrong and map_score(other) > map_score(step) - MAP_AGAINST
    return step_check("pictures", wrong, step, other, of_vision, of_other)


def step_check(
    asked: Witness, wrong: bool, step: Float64, other: Float64, vision: float, by_other: float
) -> StepCheck:
    """What a witness says of vision's step and of another one.

    Args:
        asked: the witness.
        wrong: whether the other step is to be taken.
        step: (4, 4) `T_from_to` by vision.
        other: (4, 4) `T_from_to` as the witness would have it.
        vision: how well the witness agrees with vision's step, 0-1.
        by_other: how well it agrees with the other one, 0-1.
    """
    between = log_twist(inverted(step) @ other)
    return StepCheck(
        asked,
        wrong,
        other if wrong else step,
        float(np.linalg.norm(between[:3])),
        float(np.linalg.norm(between[3:])),
        vision,
        by_other,
    )
