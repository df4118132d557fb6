"""Objects where the data set says they are."""

from __future__ import annotations

from dataclasses import dataclass

from pseudolidar.errors import LabelError
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.box import Detection


@dataclass(frozen=True)
class Labels:
    """The objects that the data set labels; regions that it ignores are none.

    Args:
        classes: only these, by any case of their names; all by default.
    """

    classes: tuple[str, ...] = ()

    def load(self) -> LabelledObjects:
        """The detector."""
        return LabelledObjects(frozenset(name.lower() for name in self.classes))


@dataclass(frozen=True)
class LabelledObjects:
    """Hands over the labels of a frame.

    Args:
        classes: in lower case; none for all.
    """

    classes: frozenset[str]

    def __call__(self, sight: Sight) -> tuple[Detection, ...]:
        """The labelled objects of a frame, in the order of its labels.

        Raises:
            LabelError: the source has no labels for the frame.
        """
        if sight.labels is None:
            raise LabelError(
                f"frame {sight.id} has no labels",
                want="a source with labels, such as KITTI object or tracking data",
                fix="Choose another detector: --detector cloud, or --detector onnx:MODEL.",
                where=sight.id,
            )
        return tuple(
            label.detection
            for label in sight.labels
            if not label.ignore
            and (not self.classes or label.detection.name.lower() in self.classes)
        )
