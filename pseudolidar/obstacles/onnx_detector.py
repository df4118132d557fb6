"""Detectors in ONNX files behind the detector protocol."""

from __future__ import annotations

import ast
import logging
import threading
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from pseudolidar.errors import ModelError, PseudolidarError, UsageError
from pseudolidar.formats.onnx.licence import licence_of
from pseudolidar.formats.onnx.model import OnnxModel, check_sha256, read_onnx
from pseudolidar.formats.onnx.session import NetworkSession, Provider
from pseudolidar.formats.onnx.trial import TrialLimits
from pseudolidar.geometry.grey import rgb8, shift_to_8_bits
from pseudolidar.obstacles.networks.answer import Answer
from pseudolidar.obstacles.networks.class_names import ClassNames, class_names, listed_names
from pseudolidar.obstacles.networks.crops import Crop, crops
from pseudolidar.obstacles.networks.feed import own_size
from pseudolidar.obstacles.networks.layout import DetectorLayout, layout_beside
from pseudolidar.obstacles.networks.letterbox import Placement, laid, placement
from pseudolidar.obstacles.networks.merging import PartFound, check_inside, merged
from pseudolidar.obstacles.networks.nms import best_boxes
from pseudolidar.obstacles.networks.recognise import answers, family_of
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.arrays import UInt8
from pseudolidar.structures.box import Detection
from pseudolidar.structures.image_size import ImageSize

_log = logging.getLogger(__name__)

_FLAG = "--detector"
# Input of a network of free size that does not say what it was trained with.
_USUAL_SIZE = ImageSize(640, 640)
# Frames whose times are kept, the last ones.
_TIMED = 4096
# Pictures in one run, where a network takes any number of them: memory grows with them.
_MOST_AT_ONCE = 8


@dataclass(frozen=True)
class OnnxDetector:
    """Objects that a network in an ONNX file finds, run by onnxruntime.

    YOLOX, YOLOv5 to YOLO12, RT-DETR, DETR, MMDetection, NanoDet and TensorFlow's are told apart by
    metadata, names, shapes and a dry run. `docs/networks.md` has the table, and where to get one.

    Args:
        path: the network, a .onnx file.
        threshold: smallest score of an object, 0-1.
        overlap: intersection over union above which two boxes of a class are one object.
        classes: only objects of these classes, a comma list such as person,car.
        tiles: look at overlapping tiles of this size too, such as 416x416, for small objects.
        names: file with the names of the classes.
        size: size that pictures are brought to, such as 640x384, for networks of free size.
        layout: what is known of how it is fed and read.
        provider: where it runs: cpu, cuda, tensorrt, openvino, coreml, directml, or auto.
        threads: of one frame; 1 is best where frames run side by side.
        sha256: refuse any other file.
        trial_seconds: time for the trial of a file that was not run before.
        trial_memory_mb: memory for it.
    """

    CHOICE: ClassVar[str] = "onnx"
    path: Path
    threshold: float = 0.3
    overlap: float = 0.5
    classes: str | None = None
    tiles: ImageSize | None = None
    names: Path | None = None
    size: ImageSize | None = None
    layout: DetectorLayout = field(default_factory=DetectorLayout)
    provider: Provider = "cpu"
    threads: int = 1
    sha256: str | None = None
    trial_seconds: float = 300.0
    trial_memory_mb: int = 8192

    def __post_init__(self) -> None:
        for name in ("threshold", "overlap"):
            value = getattr(self, name)
            if not 0 < value <= 1:
                raise UsageError(f"{name} {value}", want="above 0, at most 1", where=name)
        for name in ("threads", "trial_seconds", "trial_memory_mb"):
            value = getattr(self, name)
            if not value > 0:
                raise UsageError(f"{name} {value}", want="a positive number", where=name)

    def load(self) -> NetworkDetector:
        """The detector; says in one line what it found out about the network.

        Raises:
            ModelError: the file cannot be used, or its layout cannot be told.
            MissingDependency: the provider is not there.
        """
        from pseudolidar.obstacles.networks.trial import tried

        model = read_onnx(self.path)
        check_sha256(model, self.sha256)
        beside = layout_beside(model)
        known = self.layout.filled(beside)
        names, _origin = listed_names(model, self.names)
        if names and known.first_label != 1:
            known = known.filled(DetectorLayout(classes=len(names)))
        limits = TrialLimits(self.trial_seconds, self.trial_memory_mb, _FLAG)
        layout, cached = tried(model, known, self.input_size(model), limits)
        told = ["flags"] * (self.layout != DetectorLayout())
        told += ["its file"] * (beside != DetectorLayout())
        told.append("a dry run" + (", cached" if cached else ""))
        detector = NetworkDetector(self, model, layout, class_names(model, layout, self.names))
        detector.check_classes()
        _log.info("detector: %s; told by %s", detector.in_words(), ", ".join(told))
        return detector

    def input_size(self, model: OnnxModel) -> ImageSize:
        """The size of the input: the network's own, the one asked for, or the usual one.

        Raises:
            ModelError: another one is asked for than the network has.
        """
        own = own_size(model)
        if own is not None:
            if self.size not in (None, own):
                raise ModelError(
                    f"an input of {own}",
                    want=f"{self.size}",
                    fix="Leave --detector.size out.",
                    path=model.path,
                    where="size",
                )
            return own
        return self.size or _trained_size(model) or _USUAL_SIZE


@dataclass(eq=False)
class NetworkDetector:
    """A loaded `OnnxDetector`; one session for all threads, made anew where it was pickled to."""

    settings: OnnxDetector
    model: OnnxModel
    layout: DetectorLayout
    names: ClassNames
    _session: NetworkSession | None = field(default=None, repr=False)
    _making: threading.Lock = field(default_factory=threading.Lock, repr=False)
    _took_s: deque[float] = field(default_factory=partial(deque, maxlen=_TIMED), repr=False)

    def __getstate__(self) -> dict[str, Any]:
        kept = ("settings", "model", "layout", "names")
        return {name: getattr(self, name) for name in kept}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _session=None, _making=threading.Lock())
        self._took_s = deque(maxlen=_TIMED)

    @property
    def session(self) -> NetworkSession:
        """The network, ready to run."""
        with self._making:
            if self._session is None:
                s = self.settings
                self._session = NetworkSession(self.model, s.provider, s.threads, flag=_FLAG)
            return self._session

    def __call__(self, sight: Sight) -> tuple[Detection, ...]:
        """The objects of one frame, the surest first.

        Raises:
            ModelOutput: the network's answer means nothing.
            ModelError: it does not take the picture.
        """
        try:
            return self.detect(rgb8(sight.image, shift_to_8_bits(sight.image)))
        except PseudolidarError as error:
            raise error.located(self.model.path, f"frame {sight.id}") from None

    def detect(self, picture: UInt8) -> tuple[Detection, ...]:
        """The objects of a picture (H, W, 3) RGB, the surest first.

        Raises:
            ModelOutput: the network's answer means nothing.
            ModelError: it does not take the picture.
        """
        size = (picture.shape[0], picture.shape[1])
        parts = crops(size, self.settings.tiles)
        session = self.session
        before_s = session.seconds_here
        found = [
            self._found(answer, crop, place, size)
            for crop, place, answer in self._answered(picture, parts)
        ]
        with self._making:
            self._took_s.append(session.seconds_here - before_s)
        return merged(found, size, self.names, overlap=self.settings.overlap)

    @property
    def median_ms(self) -> float | None:
        """The network's own time for a frame, all parts of it; None before the first."""
        with self._making:
            took_s = list(self._took_s)
        return 1e3 * float(np.median(took_s)) if took_s else None

    def _answered(
        self, picture: UInt8, parts: list[Crop]
    ) -> Iterator[tuple[Crop, Placement, Answer]]:
        """Each part with its place in the input and what the network answers to it."""
        for group in self._groups(parts):
            sizes = [self._size_of(part) for part in group]
            places = [
                placement((c.width, c.height), size, self.layout.fit, (c.left, c.top))
                for c, size in zip(group, sizes, strict=True)
            ]
            inputs = [
                laid(picture, place, size, self.layout.fill)
                for place, size in zip(places, sizes, strict=True)
            ]
            fixed = self.layout.batch or 1
            full = inputs + inputs[-1:] * (fixed - len(inputs))
            answered = answers(self.session, self.layout, full, sizes[0])[: len(group)]
            yield from zip(group, places, answered, strict=True)

    def _groups(self, parts: list[Crop]) -> Iterator[list[Crop]]:
        """Parts that go into one run: as many as the network takes, of one input size."""
        most = 1 if self._as_it_is else self.layout.batch or _MOST_AT_ONCE
        for start in range(0, len(parts), most):
            yield parts[start : start + most]

    @property
    def _as_it_is(self) -> bool:
        """Each part is fed at its own size."""
        return self.layout.fit == "as-is" and not (self._own_size or self.settings.size)

    @property
    def _own_size(self) -> ImageSize | None:
        return own_size(self.model)

    def _size_of(self, part: Crop) -> ImageSize:
        """Size of the input for a part of the picture."""
        if self._as_it_is:
            return ImageSize(part.width, part.height)
        return self.settings.input_size(self.model)

    def _found(
        self, answer: Answer, crop: Crop, place: Placement, picture: tuple[int, int]
    ) -> PartFound:
        """What the network sees in a part, without what the part's edges cut."""
        s, family = self.settings, family_of(self.layout)
        found = family.read(answer, self.layout, s.threshold)
        check_inside(found, answer.size)
        if s.classes is not None:
            wanted = {label for label in set(found.labels.tolist()) if self._is_wanted(label)}
            found = found.take(np.flatnonzero(np.isin(found.labels, sorted(wanted))))
        if family.overlapping:
            found = found.take(
                best_boxes(found.boxes, found.scores, found.labels, overlap=s.overlap)
            )
        boxes = place.to_picture(found.boxes)
        whole = np.flatnonzero(~crop.cuts(boxes, picture))
        return PartFound(found.take(whole), boxes[whole], place, answer.size)

    def _is_wanted(self, label: int) -> bool:
        return self.names[label] in _listed(self.settings.classes)

    def check_classes(self) -> None:
        """Refuse wanted classes that the network does not know.

        Raises:
            UsageError: with all that it knows.
        """
        known = set(self.names.by_label.values())
        unknown = [name for name in _listed(self.settings.classes) if name not in known]
        if unknown and known:
            raise UsageError(
                f"class {unknown[0]!r}", want=f"one of {', '.join(sorted(known))}", where="classes"
            )

    def describe(self) -> dict[str, Any]:
        """What ran, plain JSON values: file, hash, licence, layout, classes, provider."""
        return {
            "file": self.model.path.name,
            "sha256": self.model.sha256(),
            "licence": licence_of(self.model),
            "signature": self.model.signature,
            "layout": self.layout.as_dict(),
            "input": str(self.settings.input_size(self.model)),
            "classes": {str(k): v for k, v in self.names.by_label.items()},
            "classes_told_by": self.names.told_by,
            "provider": self.session.provider,
        }

    def in_words(self) -> str:
        """One line for people."""
        size = self._own_size or ("the picture's" if self._as_it_is else "free")
        known = f"names by {self.names.told_by}"
        batch = {0: "any number", 1: "one"}.get(self.layout.batch or 0, str(self.layout.batch))
        return (
            f"{self.layout}; input {size}, {batch} at a time; {known}; "
            f"sha256 {self.model.sha256()[:12]}, licence: {licence_of(self.model)}; "
            f"runs on {self.session.provider}, {self.settings.threads} thread(s) a frame"
        )


def _listed(text: str | None) -> list[str]:
    return [] if text is None else [part.strip() for part in text.split(",") if part.strip()]


def _trained_size(model: OnnxModel) -> ImageSize | None:
    """`imgsz` of Ultralytics' metadata: height, width."""
    try:
        height, width = ast.literal_eval(model.metadata.get("imgsz", ""))
        return ImageSize(int(width), int(height)) if width > 0 and height > 0 else None
    except (ValueError, SyntaxError, TypeError):
        return None
