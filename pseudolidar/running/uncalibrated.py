"""Cameras that nobody calibrated, found from the pictures of a source."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.calibration.check_matches import PairMatches, match_points
from pseudolidar.calibration.known_distance import (
    KnownDistance,
    Scale,
    said_scale,
    scaled_rig,
    seen_scale,
)
from pseudolidar.calibration.uncalibrated import UncalibratedFit, fit_uncalibrated
from pseudolidar.errors import PseudolidarError, SourceEmpty, UsageError
from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.running.progress import FrameProgress
from pseudolidar.sources.bare_films import Films
from pseudolidar.sources.bare_pairs import Pictures
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import Source
from pseudolidar.sources.rectified import Rectify
from pseudolidar.sources.source import SourceSummary, evenly_placed, pairs_of
from pseudolidar.sources.video.videos import Video
from pseudolidar.structures.arrays import Image
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import RawPair

# Pairs that are matched, evenly chosen: more tell little more.
MOST_PAIRS = 20
CAMERAS = "cameras.json"


@dataclass(frozen=True, eq=False)
class PicturesOfEyes:
    """Pictures of two eyes, whatever is known of the cameras.

    Args:
        summary: where they are from.
        ids: names of the pairs.
        read: both pictures of a pair by its number.
    """

    summary: SourceSummary
    ids: tuple[str, ...]
    read: Callable[[int], tuple[Image, Image]]


@dataclass(frozen=True, eq=False)
class FoundCameras:
    """Cameras that were found, and what is known of them.

    Args:
        fit: from the matches.
        scale: how its unit became metres; None where nothing is known.
        rig: the cameras, in metres where these are known.
    """

    fit: UncalibratedFit
    scale: Scale | None
    rig: StereoRig

    @property
    def lines(self) -> tuple[str, ...]:
        """For people: how well it is known, and what is not."""
        fit, focal_px = self.fit, self.rig.left.focal_px
        froms = {
            "given": "as given",
            "seen": "that left-out matches fit best",
            "assumed": "assumed: these pictures do not tell it",
        }
        lines = [
            f"cameras found from pictures alone: {fit.agreeing} of {fit.matches} matches of "
            f"{fit.pairs} pairs agree; focal length {focal_px:.1f} px, {froms[fit.focal_from]}",
            f"rows differ by {fit.before_px:.2f} px (median), rectified by {fit.after_px:.2f}, "
            f"of matches left out of the fit by {fit.held_px:.2f}",
        ]
        shape = "angles and ratios" if fit.focal_from == "given" else "planes and straight lines"
        lines.append(
            f"shape: {shape} are those of the scene but for lens distortion, centres off the middle"
            f" of the pictures and an error of the yaw: on real pairs these add some "
            f"{fit.offset_sigma_px:.2g} px to all disparities, and what is far is wrong the most; "
            "a board tells (`pseudolidar calibrate`)"
        )
        if fit.moved_px:
            lines.append(
                f"the centre of the right pictures is taken {fit.moved_px:.1f} px farther right: "
                "else things would lie behind infinity"
            )
        if self.scale is None:
            return (
                *lines,
                "SCALE UNKNOWN: pictures alone do not tell it. Lengths are in a unit that nobody "
                "knows, not in metres; --known-distance baseline:0.12 (metres) sets it",
            )
        if not self.scale.sigma_share:
            return (*lines, f"scale: {self.scale.text}")
        between_m = float(np.linalg.norm(self.rig.T_right_left.translation_m))
        apart = f"{between_m:.4g} m +- {self.scale.sigma_share:.1%}"
        return (*lines, f"scale: {self.scale.text}; that puts the eyes {apart} apart")

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        fit = self.fit
        return {
            "focal_px": self.rig.left.focal_px,
            "focal_from": fit.focal_from,
            "pairs": fit.pairs,
            "matches": fit.matches,
            "agreeing": fit.agreeing,
            "rows_before_px": fit.before_px,
            "rows_after_px": fit.after_px,
            "rows_left_out_px": fit.held_px,
            "yaw_sigma_px": fit.yaw_sigma_px,
            "offset_sigma_px": fit.offset_sigma_px,
            "far_px": fit.far_px,
            "moved_px": fit.moved_px,
            "metric": self.rig.metric,
            "scale": None if self.scale is None else self.scale.text,
            "scale_sigma": None if self.scale is None else self.scale.sigma_share,
        }


def found_cameras(
    source: Source,
    *,
    focal_px: float | None,
    known: KnownDistance | None,
    swap: bool,
    rectify: Rectify,
) -> FoundCameras:
    """Find the cameras of a source by its pictures, whatever calibration it has.

    Args:
        source: pictures or videos of two eyes, not rectified.
        focal_px: focal length of both, where it is known.
        known: a distance that sets the scale.
        swap: exchange left and right pictures.
        rectify: how the pairs will be rectified; a known distance is looked up in such a picture.

    Raises:
        UsageError: the source is rectified already, or what is known is of no frame.
        SourceEmpty: no pair can be read.
        CalibrationValue: too little is seen to tell the cameras, or the distance.
        PairSwapped: the left camera stands on the right.
    """
    pictures = pictures_of(source)
    fit = fit_uncalibrated(matched(pictures, swap=swap), focal_px=focal_px)
    said = f"found from {fit.agreeing} matches of {fit.pairs} pairs, uncalibrated"
    rig = replace(fit.rig, origin=said)
    if known is None:
        return FoundCameras(fit, None, rig)
    if known.kind == "baseline":
        scale = said_scale(known, rig)
    else:
        offset_px = fit.offset_sigma_px
        scale = looked_up(
            known, rig, source, pictures.ids, swap=swap, rectify=rectify, offset_sigma_px=offset_px
        )
    return FoundCameras(fit, scale, scaled_rig(rig, scale))


def pictures_of(source: Source) -> PicturesOfEyes:
    """The pictures of a source without its calibration.

    Raises:
        UsageError: they are rectified.
    """
    bare: Pictures | Films | None = None
    if isinstance(source, Folders):
        bare = Pictures(
            source.path,
            source.right,
            source.left_pattern,
            source.right_pattern,
            source.tolerance_s,
            source.limits,
        )
    elif isinstance(source, Video):
        bare = Films(
            source.path,
            source.right,
            source.layout,
            source.tolerance_s,
            source.right_delay_s,
            source.limits,
        )
    if bare is not None:
        pairs = bare.open()
        return PicturesOfEyes(pairs.summary, pairs.ids, pairs.read)
    opened = source.open()
    if opened.yields is RawPair:

        def read(index: int) -> tuple[Image, Image]:
            pair = opened.load(index)
            assert isinstance(pair, RawPair)
            return pair.left, pair.right

        return PicturesOfEyes(opened.summary, opened.ids, read)
    if opened.yields is BodyFrame:
        pairs_of(opened)  # says that one pair is taken at a time
    raise UsageError(
        f"a source that is no pair of bare cameras: {opened.summary.line}",
        want="pictures or videos of two eyes as cameras take them",
        fix="Leave --uncalibrated out.",
        path=opened.summary.path,
    )


def matched(pictures: PicturesOfEyes, *, swap: bool) -> list[PairMatches]:
    """Matches of some pairs, evenly chosen; those that cannot be read are left out.

    Raises:
        SourceEmpty: none can, with the first reason.
    """
    chosen = evenly_placed(len(pictures.ids), most=MOST_PAIRS)
    found: list[PairMatches] = []
    first_error: PseudolidarError | None = None
    with FrameProgress(len(chosen), what="matching") as progress:
        for index in chosen:
            try:
                left, right = pictures.read(index)
                eyes = (right, left) if swap else (left, right)
                if eyes[0].shape == eyes[1].shape:
                    found.append(match_points(*eyes))
                progress.advance()
            except PseudolidarError as error:
                first_error = first_error or error
                progress.skip()
    sizes = {matches.size_px for matches in found}
    if len(sizes) == 1:
        return found
    why = f": {first_error}" if first_error is not None else ""
    raise SourceEmpty(
        f"pictures of {len(sizes)} sizes"
        if sizes
        else f"no pair of {len(chosen)} can be used{why}",
        want="pairs of one size, of two cameras of the same model",
        fix="Cameras that differ need a calibration: `pseudolidar calibrate`.",
        path=pictures.summary.path,
    )


@contextmanager
def as_file(rig: StereoRig) -> Iterator[Path]:
    """The rig as a file that sources can be opened with, while the block lasts."""
    with tempfile.TemporaryDirectory(prefix="pseudolidar-") as folder:
        path = Path(folder) / CAMERAS
        write_rig(path, rig)
        yield path


def looked_up(
    known: KnownDistance,
    rig: StereoRig,
    source: Source,
    ids: tuple[str, ...],
    *,
    swap: bool,
    rectify: Rectify,
    offset_sigma_px: float,
) -> Scale:
    """The scale by what a picture shows where the distance is known.

    Args:
        known: the distance, and the pixels that it is of.
        rig: the cameras, of unknown scale.
        source: where the picture is from.
        ids: of its frames.
        swap: exchange left and right pictures.
        rectify: how pairs are rectified.
        offset_sigma_px: what all disparities may be off by together.

    Raises:
        UsageError: no such frame.
        CalibrationValue: nothing is matched there.
    """
    from pseudolidar.stereo.census import Census

    name = known.id or ids[0]
    if name not in ids:
        raise UsageError(
            f"no frame {name!r}", want=f"one such as {ids[0]!r}", where="known_distance"
        )
    with as_file(rig) as path:
        pairs = pairs_of(opened_with_rig(source, path, swap=swap, rectify=rectify))
        frame = pairs.load(pairs.ids.index(name))
    disparity = Census(quality="fine").load()(frame)
    plan = rectify.plans(rig)[0]
    return seen_scale(known, plan, disparity, offset_sigma_px=offset_sigma_px)
