"""Several stereo pairs on one body: a rig file with all of them, and a folder for each."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from pseudolidar.errors import NoPairs, PseudolidarError, SourceUnknown
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.body_json import MARK, body_text, has_pairs, read_body
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.rectification import aligning_rotations
from pseudolidar.sources.moments import moments_of
from pseudolidar.sources.rectified import RectifiedSource, Rectify
from pseudolidar.sources.selection import whole
from pseudolidar.sources.source import (
    KIND_NAMES,
    FrameSequence,
    FrameSource,
    SourceSummary,
    pairs_of,
)
from pseudolidar.structures.body import BodyFrame, BodyRig, MountedPair
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import Frame

RIG_FILE = "rig.json"


@dataclass(frozen=True)
class Body:
    """Pairs of several rigs on one body, in a folder for each pair.

    `rig.json` in the folder has the pairs by name, each with its place on the body; the folder of
    that name has its pictures, in any form that is known alone: folders left and right, videos.

    Args:
        path: the folder.
        rig: another rig file with pairs of these names.
        tolerance_s: how far apart pictures of one moment may be; by default 0.4 of the usual time
            between frames. Pictures with equal names belong together whatever their times.
        limits: caps on untrusted files.
    """

    path: str
    rig: str | None = None
    tolerance_s: float | None = None
    limits: Limits = field(default=DEFAULT_LIMITS)

    @classmethod
    def looks_like(cls, path: Path) -> bool:
        """Whether `path` is a folder with a rig file of several pairs."""
        file = path / RIG_FILE
        return path.is_dir() and file.is_file() and has_pairs(file)

    @property
    def rig_file(self) -> Path:
        """The file with the pairs."""
        return Path(self.path) / RIG_FILE if self.rig is None else Path(self.rig)

    def open(self) -> BodySource:
        """As `opened`, unrectified pairs rectified as usual."""
        return self.opened(Rectify())

    def opened(self, rectify: Rectify) -> BodySource:
        """Open the source of each pair, and find which frames are of one moment.

        Args:
            rectify: how unrectified pairs are rectified.

        Raises:
            CalibrationMissing, CalibrationSyntax, CalibrationField, CalibrationValue: of the file.
            SourceUnknown: no folder of a pair's name, or nothing known in it.
            SourceEmpty: no frames of one moment.
        """
        body = read_body(self.rig_file, limits=self.limits)
        sources = tuple(self._pair_source(pair, rectify) for pair in body.pairs)
        moments = moments_of(self.path, sources, tolerance_s=self.tolerance_s)
        return BodySource(self.path, body, sources, tuple(moments.items()))

    def _pair_source(self, pair: MountedPair, rectify: Rectify) -> FrameSource:
        # A folder of a pair is any source, and this is one of them.
        from pseudolidar.sources.other_rig import opened_with_rig
        from pseudolidar.sources.recognise import recognise

        folder = Path(self.path) / pair.name
        if not folder.exists():
            raise SourceUnknown(
                f"no folder {pair.name}",
                want=f"the pictures of the pair {pair.name!r} of {self.rig_file.name}",
                path=folder,
            )
        rig = Path(f"{self.rig_file}{MARK}{pair.name}")
        return pairs_of(opened_with_rig(recognise(str(folder)), rig, rectify=rectify))


@dataclass(frozen=True, eq=False)
class BodySource:
    """The pairs of a body, opened.

    Args:
        path: what the user gave.
        body: pairs and their places.
        sources: of each pair, in the order of `body`.
        moments: id of each frame, and its index in each source; None where that has none.
    """

    path: str
    body: BodyRig
    sources: tuple[FrameSource, ...]
    moments: tuple[tuple[str, tuple[int | None, ...]], ...]
    yields: ClassVar = BodyFrame
    rig: ClassVar = None

    @property
    def parts(self) -> Mapping[str, FrameSource]:
        """The source of each pair, by its name."""
        return dict(zip(self.body.names, self.sources, strict=True))

    @property
    def summary(self) -> SourceSummary:
        """What it is."""
        names = ", ".join(f"{number} {name}" for number, name in enumerate(self.body.names))
        incomplete = sum(None in indices for _, indices in self.moments)
        notes = [f"column source: {names}"]
        notes += [f"frames without all pairs: {incomplete}"] if incomplete else []
        notes += _notes_of({name: source.summary.notes for name, source in self.parts.items()})
        nearest_m = [s.summary.nearest_m for s in self.sources if s.summary.nearest_m is not None]
        return SourceSummary(
            kind="body",
            path=self.path,
            line=f"{len(self.sources)} stereo pairs on one body ({', '.join(self.body.names)}): "
            f"{len(self.moments)} frames",
            notes=tuple(notes),
            camera=_camera_words(self.body),
            nearest_m=min(nearest_m, default=None),
        )

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the frames: those of the first pair that has them."""
        return tuple(name for name, _ in self.moments)

    @property
    def timestamps_ns(self) -> tuple[int, ...]:
        """Times of the frames: those of the first pair that has them."""
        return tuple(
            next(
                source.timestamps_ns[index]
                for source, index in zip(self.sources, indices, strict=True)
                if index is not None
            )
            for _, indices in self.moments
        )

    @property
    def refused(self) -> tuple[tuple[str, PseudolidarError], ...]:
        """Nothing: a pair that has no picture is left out of its frame."""
        return ()

    def load(self, index: int) -> BodyFrame:
        """What all pairs see at one moment; a pair that cannot be read is noted.

        Raises:
            PseudolidarError: not one pair can be read.
        """
        name, indices = self.moments[index]
        pairs: dict[str, StereoFrame] = {}
        notes: list[str] = []
        error: PseudolidarError | None = None
        for number, (pair, source) in enumerate(self.parts.items()):
            at = indices[number]
            if at is None:
                notes.append(f"{pair}: no pictures of this moment")
                continue
            try:
                pairs[pair] = source.load(at)
            except PseudolidarError as fault:
                error = fault
                notes.append(f"{pair} left out: {fault}")
        if not pairs:
            assert error is not None  # each moment has a picture of some pair
            raise error
        return self._frame(name, index, pairs, tuple(notes))

    def _frame(
        self, name: str, index: int, pairs: Mapping[str, StereoFrame], notes: tuple[str, ...]
    ) -> BodyFrame:
        places = {pair: rectified_place(self.body[pair]) for pair in pairs}
        told = tuple(f"{pair}: {note}" for pair, frame in pairs.items() for note in frame.notes)
        scanned = next((pair for pair, frame in pairs.items() if frame.scan is not None), None)
        lidar = None if scanned is None else pairs[scanned].rig.T_left_velodyne
        return BodyFrame(
            pairs,
            places,
            self.body.names,
            id=name,
            index=index,
            timestamp_ns=next(iter(pairs.values())).timestamp_ns,
            pose=_pose(pairs, places),
            scan=None if scanned is None or lidar is None else pairs[scanned].scan,
            T_base_link_lidar=None if scanned is None or lidar is None else places[scanned] @ lidar,
            notes=(*notes, *told),
        )


def parts_of(source: FrameSequence[Frame]) -> Mapping[str, FrameSource]:
    """The sources of the pairs of a body, or of the views of a pair; none of any other source."""
    every = whole(source)
    if isinstance(every, RectifiedSource):
        return {name: pairs_of(view) for name, view in every.parts.items()}
    return every.parts if isinstance(every, BodySource) else {}


def body_of(source: FrameSequence[Frame]) -> BodyRig:
    """The rig of a source of several pairs.

    Raises:
        NoPairs: it is none.
    """
    every = whole(source)
    if isinstance(every, BodySource):
        return every.body
    raise NoPairs(
        f"a source of {KIND_NAMES[source.yields]}",
        want=KIND_NAMES[BodyFrame],
        fix="Give a folder with a rig.json of several pairs, and a folder for each.",
        path=source.summary.path,
    )


def rectified_place(pair: MountedPair) -> Pose:
    """`T_base_link_left` of the rectified left camera: turned, where the pair's own is not."""
    if pair.rig.is_rectified:
        return pair.T_base_link_left
    R_left, _ = aligning_rotations(pair.rig.T_right_left)
    left = pair.rig.left.frame
    return pair.T_base_link_left @ Pose.from_rotation(left, left, R_left.T, np.zeros(3))


def _notes_of(parts: Mapping[str, tuple[str, ...]]) -> list[str]:
    """Notes of the pairs with their names; what all of them say is said once."""
    first = next(iter(parts.values()))
    shared = [note for note in first if all(note in notes for notes in parts.values())]
    own = [
        f"{name}: {note}" for name, notes in parts.items() for note in notes if note not in shared
    ]
    return [*shared, *own]


def _pose(pairs: Mapping[str, StereoFrame], places: Mapping[str, Pose]) -> Pose | None:
    """`T_map_base_link` by the first pair that knows where its own body is."""
    for name, frame in pairs.items():
        if frame.pose is not None:
            T_map_left = frame.pose @ left_in_base_link(frame.rig)
            return T_map_left @ places[name].inverse()
    return None


def _camera_words(body: BodyRig) -> str:
    """Rigs and places in words: the same words, the same results."""
    digest = hashlib.sha256(body_text(body).encode()).hexdigest()
    return f"{', '.join(body.names)}: sha256 {digest}"


def pair_folders(settings: Body) -> tuple[str, ...]:
    """Names of the folders of the pairs; none where the rig file cannot be read."""
    try:
        return read_body(settings.rig_file, limits=settings.limits).names
    except PseudolidarError:
        return ()  # opening the source says why


def with_rig_file(settings: Body, rig: Path) -> Body:
    """The same pictures with another file of pairs."""
    return replace(settings, rig=str(rig))
