"""Frames of a body to the sights that its pairs are aligned by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pseudolidar.calibration.overlap import Overlap, Sight
from pseudolidar.calibration.overlap_board import BoardSight, SharedBoard, read_alike
from pseudolidar.calibration.overlap_partners import AnySight
from pseudolidar.errors import PseudolidarError
from pseudolidar.running.matching import MatchFrame, Refining
from pseudolidar.sources.body import parts_of
from pseudolidar.sources.source import FrameSequence
from pseudolidar.stereo.eyes import Eyes
from pseudolidar.stereo.filters.clean import Clean
from pseudolidar.stereo.matcher import MatcherSettings
from pseudolidar.stereo.reproject import Reproject, Reprojector
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import Frame


@dataclass(frozen=True, eq=False)
class FrameSights:
    """What the pairs of a body see in one frame.

    Args:
        sights: by the name of the pair.
        lost: why other pairs show nothing, by their names.
    """

    sights: Mapping[str, AnySight]
    lost: Mapping[str, PseudolidarError] = field(default_factory=dict)


@dataclass(frozen=True)
class SeeFrame:
    """Matches and reprojects each pair of a frame, and keeps what alignment needs: picklable.

    Args:
        match: of each pair, by its name.
        reproject: disparity to points of the left camera.
        overlap: which points count.
    """

    match: Mapping[str, MatchFrame]
    reproject: Reprojector
    overlap: Overlap

    @classmethod
    def of(
        cls,
        source: FrameSequence[Frame],
        matcher: MatcherSettings,
        overlap: Overlap,
        *,
        eyes: Eyes,
        min_depth_m: float | None,
    ) -> SeeFrame:
        """With everything heavy loaded.

        Args:
            source: of several pairs on one body.
            matcher: how disparities are found.
            overlap: which points count.
            eyes: what is done to each pair before.
            min_depth_m: nearest depth that must be found.
        """
        match = {
            name: MatchFrame.load(
                part, matcher, Refining(), Clean(), eyes=eyes, min_depth_m=min_depth_m
            )
            for name, part in parts_of(source).items()
        }
        return cls(match, Reproject(max_range_m=overlap.most_m).load(), overlap)

    def __call__(self, frame: Frame) -> FrameSights:
        """The sights of a frame of a body.

        Raises:
            PseudolidarError: not one pair shows anything.
        """
        assert isinstance(frame, BodyFrame)  # `of` takes no other source
        sights: dict[str, Sight] = {}
        lost: dict[str, PseudolidarError] = {}
        for name, pair in frame.pairs.items():
            try:
                cloud = self.reproject(pair, self.match[name].disparity(pair))
                sights[name] = Sight.of(cloud, self.overlap)
            except PseudolidarError as fault:
                lost[name] = fault
        if not sights:
            raise next(iter(lost.values()))
        return FrameSights(sights, lost)


@dataclass(frozen=True)
class SeeBoard:
    """Finds the board in each pair of a frame; picklable.

    Args:
        board: which one.
        places: `T_base_link_left` of the pairs, roughly: which end a chessboard is read from.
    """

    board: SharedBoard
    places: Mapping[str, Pose]

    def __call__(self, frame: Frame) -> FrameSights:
        """Corners of the board in each pair that sees it with both eyes."""
        assert isinstance(frame, BodyFrame)  # the source is that of a body
        pattern = self.board.pattern
        found = {name: BoardSight.of(pair, pattern) for name, pair in frame.pairs.items()}
        seen = {name: sight for name, sight in found.items() if sight is not None}
        return FrameSights(read_alike(seen, self.places, pattern))
