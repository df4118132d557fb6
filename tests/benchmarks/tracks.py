"""Tracks in a street with crossing and turning cars, against exact truth and 2D tracking.

    python -m tests.benchmarks.tracks [SEEDS]

Obstacles are boxes of the truth, disturbed as stereo disturbs them (`tests/obstacles/junction.py`):
0.25 px of disparity along the ray, half of its variance staying for 3 s, 0.1 m across, 5 % missed,
30 % more of the half hidden, a false one in every third frame. 2D tracking is given the same.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

from pseudolidar.evaluation.tracks import ToldTrack, TrackJudge, TrackScore, pooled
from pseudolidar.obstacles.motion_filter import Straight
from pseudolidar.obstacles.tracker import Followed, Tracker
from tests.benchmarks.iou_tracks import IouTracker
from tests.obstacles.junction import Errors, Moment, moments

SEEDS = 20
HEAD = (
    "missed  wrong  switches  fragments   MOTA   velocity off: median, 90 %   within 1, 2 sigma  "
    "NEES   hidden off"
)


def told(followed: Followed) -> list[ToldTrack]:
    """What a user is told: tracks that are believed, and where those are that are hidden."""
    seen = [
        ToldTrack(
            one.track.track_id,
            one.track.box,
            one.track.velocity_m_s,
            one.track.sigma_velocity_m_s,
            box_px=one.detection.box_px,
        )
        for one in followed.obstacles
        if one.track and one.track.state == "confirmed"
    ]
    return seen + [ToldTrack(t.track_id, t.box, coasting=True) for t in followed.coasting]


def score(settings: Tracker, frames: Iterable[Moment]) -> TrackScore:
    """Of our tracker over one street."""
    follow, judge = settings.load(), TrackJudge()
    for frame in frames:
        followed = follow(frame.obstacles, frame.timestamp_ns, frame.T_map_camera)
        judge.add(frame.truth, told(followed))
    return judge.score()


def score_2d(frames: Iterable[Moment]) -> TrackScore:
    """Of 2D tracking over the same."""
    settings = Tracker()
    follow = IouTracker(confirm=settings.confirm, coast_s=settings.coast_s)
    judge = TrackJudge()
    for frame in frames:
        tracks = follow(frame.obstacles, frame.timestamp_ns, frame.T_map_camera)
        judge.add(frame.truth, tracks)
    return judge.score()


def line(name: str, one: TrackScore) -> str:
    """One row of the table."""
    figures = one.as_dict()
    row = f"{name:22s} {one.missed:6d} {one.wrong:6d} {one.switches:9d} {one.fragments:10d}"
    row += f"  {one.mota:5.3f}   {figures['velocity_median_abs_m_s']:8.2f}, "
    row += f"{figures['velocity_p90_abs_m_s']:.2f} m/s"
    if one.within_1_sigma is None:
        return row
    row += f"        {one.within_1_sigma:11.0%}, {one.within_2_sigma:.0%}"
    return f"{row}   {one.normalised_squared:5.2f}   {figures['coasting_median_abs_m']:.2f} m"


def main(seeds: int = SEEDS) -> None:
    """Print the tables."""
    for title, errors in (
        ("half of the error stays", Errors()),
        ("all of the error changes", Errors(persistent=0.0)),
        ("all of the error stays", Errors(persistent=1.0)),
    ):
        streets: Sequence[list[Moment]] = [list(moments(s, errors=errors)) for s in range(seeds)]
        ours = pooled([score(Tracker(), frames) for frames in streets])
        print(f"{title}: {seeds} streets of 8 s, {ours.objects} objects")
        print(f"{'':22s} {HEAD}")
        print(line("3D, turning", ours), flush=True)
        straight = Tracker(motion=Straight())
        print(line("3D, straight", pooled([score(straight, frames) for frames in streets])))
        print(line("2D by overlap", pooled([score_2d(frames) for frames in streets])), flush=True)


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
