"""Unrectified pairs rectified as they load: the one place where that is done."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pseudolidar.formats.rigs.rig_json import rig_text
from pseudolidar.formats.rigs.rig_reading import Pictures
from pseudolidar.geometry.frames import left_in_base_link, on_moved_base
from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.odd_rig import field_deg
from pseudolidar.geometry.rectification import (
    FISHEYE_FIELD_DEG,
    Rectification,
    rectification,
)
from pseudolidar.geometry.rectified_pixels import PairMaps
from pseudolidar.geometry.virtual_views import virtual_views
from pseudolidar.sources.over import SourceOver
from pseudolidar.sources.source import FrameSequence, SourceSummary
from pseudolidar.sources.swapped import swapped
from pseudolidar.sources.wrapped import rewrapped, unwrapped
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import RawPair, StereoFrame
from pseudolidar.structures.image_size import ImageSize
from pseudolidar.structures.motion import BodyMotion
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import Frame, HeldFrame

# Plans of so many rigs are kept: one takes as long as rectifying a pair.
PLANS_KEPT = 8
# Lenses that see more than a flat picture shows, by this, deserve a word.
WORTH_SAYING_DEG = 25.0
# Field that is offered to who wants more of the sides, in pictures twice as wide as usual.
WIDE_FIELD_DEG = 150.0


@dataclass(frozen=True)
class Rectify:
    """How unrectified pairs become rectified ones, as they load; others are left as they are.

    Args:
        alpha: 0 zooms in until every pixel shows something, 1 out until nothing is lost.
        zoom: focal length times this, after that.
        size: of the rectified pictures, by default that of the left ones.
        field_deg: how much of what a fisheye sees counts for that; of a view its width.
        views: 1 for one flat picture of each eye. More are slices around the baseline that
            together show all a fisheye sees from above over ahead to below; their points become
            one cloud, with a column `source`.
        pictures: raw or rectified, where a calibration knows both; auto takes them for rectified
            there, and for raw where only that fits.
    """

    alpha: float = 0.0
    zoom: float = 1.0
    size: ImageSize | None = None
    field_deg: float = FISHEYE_FIELD_DEG
    views: int = 1
    pictures: Pictures = "auto"

    @property
    def usual(self) -> bool:
        """Whether the pictures are those that corrections of rows and disparities are fitted to."""
        return replace(self, pictures="auto") == Rectify()

    def plans(self, raw: StereoRig) -> tuple[Rectification, ...]:
        """How pairs of a rig become rectified ones, one plan for each view.

        Raises:
            UsageError, CalibrationValue: as `rectification` and `virtual_views`.
        """
        if not self.usual:
            raw = replace(raw, rows=None, correction=None)
        size_px = None if self.size is None else (self.size.width, self.size.height)
        if self.views == 1:
            return (
                rectification(
                    raw,
                    alpha=self.alpha,
                    zoom=self.zoom,
                    size_px=size_px,
                    field_deg=self.field_deg,
                ),
            )
        return virtual_views(
            raw,
            self.views,
            zoom=self.zoom,
            width_px=size_px and size_px[0],
            field_deg=self.field_deg,
        )


def with_pairs_rectified(
    source: FrameSequence[HeldFrame], rectify: Rectify
) -> FrameSequence[Frame]:
    """The source with its unrectified pairs rectified, where it has some.

    Args:
        source: of any frames.
        rectify: how.

    Raises:
        UsageError, CalibrationValue: they cannot be rectified so.
    """
    if source.yields is not RawPair or source.rig is None:
        return source  # type: ignore[return-value]  # it has no unrectified pairs
    plans = _plans(rectify, source.rig)
    note = _note(source.rig, plans, rectify)
    if not rectify.usual and (source.rig.rows or source.rig.correction):
        note += "; corrections of the rig left out: they were fitted to pictures of another shape"
    return RectifiedSource(source, rectify, plans[0].rig if len(plans) == 1 else None, note)


def in_one_view(source: FrameSequence[Frame]) -> FrameSequence[Frame]:
    """The source with one flat picture of each eye, where it has several views."""
    if source.yields is not BodyFrame:
        return source
    return rewrapped(source, _one_view)


def _one_view(source: FrameSequence[Frame]) -> FrameSequence[Frame]:
    if not isinstance(source, RectifiedSource):
        return source
    return with_pairs_rectified(source.source, replace(source.rectify, views=1, size=None))


def exchanged(source: FrameSequence[Frame]) -> FrameSequence[Frame]:
    """The source with the pictures of unrectified pairs exchanged before they are rectified."""
    return rewrapped(source, _exchanged)


def _exchanged(source: FrameSequence[Frame]) -> FrameSequence[Frame]:
    if not isinstance(source, RectifiedSource):
        return source
    return replace(source, source=swapped(source.source))


def raw_rig(source: FrameSequence[HeldFrame]) -> StereoRig | None:
    """The rig of the pictures as they were taken, where they are rectified as they load."""
    inner = unwrapped(source)
    return inner.source.rig if isinstance(inner, RectifiedSource) else None


@dataclass(frozen=True, eq=False)
class RectifiedSource(SourceOver):
    """A source whose unrectified pairs are rectified as they load.

    Args:
        source: where they come from.
        rectify: how.
        rig: rectified rig of the first frame; None where there are several views.
        note: what is done, for people.
        view: the only view that is wanted of several.
    """

    source: FrameSequence[HeldFrame]
    rectify: Rectify
    rig: StereoRig | None = field(repr=False)
    note: str
    view: int | None = None

    @property
    def summary(self) -> SourceSummary:
        """What it is, and what is done to it."""
        summary = self.source.summary
        raw = self.source.rig
        camera = summary.camera if self.rig is not None or raw is None else _words(raw)
        return replace(summary, notes=(*summary.notes, self.note), camera=camera)

    @property
    def yields(self) -> type[Frame]:
        """What its frames are."""
        several = self.rectify.views > 1 and self.view is None
        return BodyFrame if several else StereoFrame

    @property
    def parts(self) -> Mapping[str, FrameSequence[Frame]]:
        """The views as sources of their own, by their names; none where there is one."""
        raw = self.source.rig
        if self.yields is StereoFrame or raw is None:
            return {}
        plans = _plans(self.rectify, raw)
        return {
            name_of_view(number): replace(self, rig=plan.rig, view=number)
            for number, plan in enumerate(plans)
        }

    def load(self, index: int) -> Frame:
        """Frame `index`, rectified."""
        frame = self.source.load(index)
        if not isinstance(frame, RawPair):
            return frame
        if self.view is not None:
            return _flat(frame, _plans(self.rectify, frame.rig)[self.view])
        return rectified(frame, self.rectify)


def name_of_view(number: int) -> str:
    """Name of a view among the pairs of a body."""
    return f"view_{number}"


def rectified(pair: RawPair, rectify: Rectify) -> StereoFrame | BodyFrame:
    """An unrectified pair as a rectified one, or as several views.

    Raises:
        UsageError, CalibrationValue: it cannot be rectified so.
    """
    plans = _plans(rectify, pair.rig)
    if rectify.views == 1:
        return _flat(pair, plans[0])
    straight = _plans(Rectify(), pair.rig)[0]
    T_base_left = left_in_base_link(straight.rig)
    names = tuple(name_of_view(number) for number in range(len(plans)))
    turns = (
        Pose.from_rotation(
            T_base_left.src, T_base_left.src, straight.R_left @ plan.R_left.T, np.zeros(3)
        )
        for plan in plans
    )
    lidar = straight.rig.T_left_velodyne
    return BodyFrame(
        {
            name: _flat(replace(pair, notes=()), plan)
            for name, plan in zip(names, plans, strict=True)
        },
        {name: T_base_left @ turn for name, turn in zip(names, turns, strict=True)},
        names,
        id=pair.id,
        index=pair.index,
        timestamp_ns=pair.timestamp_ns,
        pose=_on_body(pair, straight)[0],
        scan=None if lidar is None else pair.scan,
        T_base_link_lidar=lidar and T_base_left @ lidar,
        notes=pair.notes,
    )


def _flat(pair: RawPair, plan: Rectification) -> StereoFrame:
    maps = PairMaps.of(plan)
    left, right = maps.apply(pair.left, pair.right)
    pose, motion = _on_body(pair, plan)
    return StereoFrame(
        left,
        right,
        plan.rig,
        pair.id,
        pair.index,
        pair.timestamp_ns,
        scan=pair.scan,
        pose=pose,
        motion=motion,
        notes=pair.notes,
        mask=maps.mask,
    )


@functools.lru_cache(PLANS_KEPT)  # by identity: a source has one rig, or one for each scene
def _plans(rectify: Rectify, raw: StereoRig) -> tuple[Rectification, ...]:
    return rectify.plans(raw)


def _words(raw: StereoRig) -> str:
    """The cameras in words: the same words, the same results."""
    text = rig_text(replace(raw, origin=""))
    return f"unrectified cameras: sha256 {hashlib.sha256(text.encode()).hexdigest()}"


def _on_body(pair: RawPair, plan: Rectification) -> tuple[Pose | None, BodyMotion | None]:
    """Pose and motion for the `base_link` of the rectified rig, which turns with the left camera.

    Where a LiDAR or an IMU is the body, nothing changes.
    """
    if pair.rig.T_left_velodyne is not None:
        return pair.pose, pair.motion
    T_new_old = left_in_base_link(plan.rig).matrix @ plan.T_rectified_left.matrix
    T_new_old = T_new_old @ left_in_base_link(pair.rig).inverse().matrix
    return on_moved_base(pair.pose, pair.motion, T_new_old)


def _note(raw: StereoRig, plans: tuple[Rectification, ...], rectify: Rectify) -> str:
    """What is done, in one line: lenses, size, focal length, field of view."""
    camera = plans[0].rig.left
    fields = field_deg(camera)
    kinds = dict.fromkeys(
        _lens_text(eye.model, len(eye.distortion)) for eye in (raw.left, raw.right)
    )
    sizes = dict.fromkeys(f"{eye.width_px}x{eye.height_px}" for eye in (raw.left, raw.right))
    line = f"rectified as they load: {' and '.join(kinds)}, {' and '.join(sizes)} px"
    size = f"{camera.width_px}x{camera.height_px} px, f {camera.focal_px:.1f} px"
    if len(plans) > 1:
        line += f" to {len(plans)} views around the baseline"
        return f"{line}, each {size}, {fields[0]:.0f} deg wide{_sides_text(raw, fields[0])}"
    line += f" to {size}, {fields[0]:.0f} x {fields[1]:.0f} deg (alpha {rectify.alpha:g}"
    line += f", zoom {rectify.zoom:g})" if rectify.zoom != 1 else ")"
    seen_deg = _seen_deg(raw)[1]
    if seen_deg > fields[1] + WORTH_SAYING_DEG and raw.left.model == "fisheye":
        line += f"; the lenses see {seen_deg:.0f} deg of height: --rectify.views 3 takes all of it"
    return line + _sides_text(raw, fields[0])


def _sides_text(raw: StereoRig, field_deg: float) -> str:
    """What the pictures do not show to the left and right, or nothing."""
    seen_deg = _seen_deg(raw)[0]
    if raw.left.model != "fisheye" or seen_deg <= field_deg + WORTH_SAYING_DEG:
        return ""
    told = f"; the lenses see {seen_deg:.0f} deg of width, the sides are left out"
    if field_deg > WIDE_FIELD_DEG - 1:
        return told
    return f"{told}: --rectify.field-deg {WIDE_FIELD_DEG:.0f} shows more of them"


def _lens_text(model: str, coefficients: int) -> str:
    return f"{model} lenses ({coefficients} coefficients)" if coefficients else f"{model} lenses"


def _seen_deg(raw: StereoRig) -> tuple[float, float]:
    """Width and height of what the left lens sees through its centre, degrees; beyond 180, too."""
    camera = raw.left
    centre = camera.K[:2, 2]
    seen = []
    for axis, side_px in enumerate(camera.size_px):
        ends = np.array([centre, centre])
        ends[:, axis] = 0.0, side_px - 1.0
        first, last = Lens.of(camera).nearest_directions(ends)[:, [axis, 2]]
        seen.append(np.rad2deg(np.arctan2(*last) - np.arctan2(*first)))
    return float(seen[0]), float(seen[1])
