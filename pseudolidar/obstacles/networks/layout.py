"""How a detector's input is fed and its outputs are read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

from pseudolidar.errors import ModelError
from pseudolidar.formats.onnx.description import (
    as_flags,
    check_choices,
    filled,
    json_beside,
    known_values,
    of_metadata,
    of_values,
)
from pseudolidar.formats.onnx.model import OnnxModel
from pseudolidar.formats.onnx.pixels import Channels, Normalisation

FamilyName = Literal[
    "yolox",
    "yolov5",
    "ultralytics",
    "nanodet",
    "end-to-end",
    "rows",
    "queries",
    "pairs",
    "labels-boxes-scores",
    "dets-labels",
    "tf-od",
]
Fit = Literal["corner", "centre", "stretch", "as-is"]
BoxUnit = Literal["pixel", "share", "grid"]

FAMILY_NAMES: tuple[str, ...] = get_args(FamilyName)
# Keys of a JSON file beside a network that name its classes, and are no fields of the layout.
NAMES_KEYS = ("names", "classes_names", "id2label", "labels")
_EXAMPLE = 'an object such as {"family": "yolox", "channels": "bgr"}'


@dataclass(frozen=True)
class DetectorLayout:
    """What is known of a detector's layout; None is not known yet, and will be found out.

    Args:
        family: how boxes and scores lie in the outputs; `docs/networks.md` draws each.
        normalisation: of pixel values: raw 0..255, unit 0..1, centred -1..1, imagenet (unit, mean
            and deviation of ImageNet taken off).
        channels: order of colours, or grey.
        fit: how a picture is brought to the input's size: its shape kept and laid into the corner
            or the centre, stretched, or as it is.
        fill: level around a picture whose shape is kept, 0..255.
        boxes: pixels of the input, shares of it, or offsets in a grid (YOLOX as it is trained).
        classes: number of classes.
        first_label: number of the first class; 1 where 0 means background.
        batch: pictures that one run takes; 0 is any number.
    """

    family: FamilyName | None = None
    normalisation: Normalisation | None = None
    channels: Channels | None = None
    fit: Fit | None = None
    fill: int | None = None
    boxes: BoxUnit | None = None
    classes: int | None = None
    first_label: int | None = None
    batch: int | None = None

    def __post_init__(self) -> None:
        for name, least, most in (
            ("fill", 0, 255),
            ("classes", 1, None),
            ("first_label", 0, 1),
            ("batch", 0, None),
        ):
            value = getattr(self, name)
            if value is not None and (value < least or (most is not None and value > most)):
                want = f"at least {least}" if most is None else f"{least} to {most}"
                raise ModelError(f"{name} {value}", want=want, where=name)
        check_choices(self)

    def filled(self, other: DetectorLayout) -> DetectorLayout:
        """With what `other` knows where this one does not."""
        return filled(self, other)

    def as_dict(self) -> dict[str, Any]:
        """The known fields, plain JSON values."""
        return known_values(self)

    def flags(self) -> str:
        """The command line flags that say the same."""
        return as_flags(self, "--detector.layout")

    def __str__(self) -> str:
        """One line for people; for a layout that is known completely."""
        fit = {
            "corner": f"its shape kept in the corner, {self.fill} around",
            "centre": f"its shape kept in the centre, {self.fill} around",
            "stretch": "stretched",
        }.get(self.fit or "", "as it is")
        return (
            f"{self.family}, boxes in {self.boxes}, {self.classes or 'any number of'} classes; "
            f"{self.channels} {self.normalisation}, {fit}"
        )


def layout_beside(model: OnnxModel) -> DetectorLayout:
    """What a network's own metadata say, or a JSON file of its name beside it, which counts first.

    Raises:
        ModelError: one of them cannot be read.
    """
    found = json_beside(model, _EXAMPLE)
    told = of_metadata(DetectorLayout, model)
    # A list, or the configuration of a training framework, only names the classes.
    if found is None or not isinstance(found[1], dict) or "model_type" in found[1]:
        return told
    path, values = found
    fields = {key: value for key, value in values.items() if key not in NAMES_KEYS}
    return of_values(DetectorLayout, fields, path).filled(told)
