"""Whether both pictures are of one moment: a rig that drives on stands elsewhere for the second.

A single pair shows only that one eye stands ahead of the other, which a rig that is mounted so does
too. With the frames before and after it is told apart: the right picture that belongs to a left
one is the one whose eye stands beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

from pseudolidar.calibration.check_epipolar import RowFit
from pseudolidar.calibration.check_finding import SUREST, Finding, sure_beyond
from pseudolidar.calibration.check_rows import STOP_PX, enough

SYNC = "sync"
# How far one eye stands ahead of the other, in baselines, to be noticed, and how sure that must be.
# KITTI, Middlebury and rendered pairs have up to 0.17 +- 0.02; a frame late at 9 m/s 0.4 to 2.2.
AHEAD, AHEAD_SIGMAS = 0.3, 4.0
# The direction must explain the rows much better than rectification alone does.
EXPLAINED = 0.7
# Distance driven from frame to frame, in baselines, that a shifted pair would show.
MOVING = 0.4
# The right picture of another frame belongs to a left one if its rows fit so much better, and are
# off by so much less. Of KITTI and rendered pairs a frame late: 0.2 to 0.53, and 0.01 to 0.2.
BELONGS, BELONGS_PX = 0.6, 0.5
# How sure a share of a frame is: the rig may not have driven evenly.
ABOUT = 0.95
MEND = (
    "Pair the pictures by their times, or leave out the frames that one side has dropped; "
    "--no-check is silent."
)


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Fits of the same left picture with the right ones of other moments.

    Args:
        before: with that of the frame before, None where there is none.
        after: with that of the frame after.
    """

    before: RowFit | None
    after: RowFit | None


def stands_ahead(rectified: RowFit | None, directed: RowFit | None) -> bool:
    """Whether a pair looks as if one eye stood ahead of the other.

    Args:
        rectified: fit without the direction from eye to eye.
        directed: fit with it.
    """
    if rectified is None or directed is None or not enough(directed):
        return False
    ahead = abs(directed.direction[1])
    return (
        ahead > AHEAD
        and ahead > AHEAD_SIGMAS * directed.forward_sigma
        and directed.cost < EXPLAINED * rectified.cost
    )


def sync_found(
    rectified: RowFit | None, directed: RowFit | None, neighbours: Neighbours | None
) -> Finding:
    """Judge whether both pictures were taken at one moment.

    Args:
        rectified: fit of the pair without the direction from eye to eye.
        directed: fit with it.
        neighbours: fits with right pictures of other moments, where they were looked at.
    """
    if directed is None or not enough(directed):
        return Finding(SYNC, "unknown", "cannot tell: too few matches agree")
    ahead, sigma = directed.direction[1], directed.forward_sigma
    figures: dict[str, float | int | None] = {"ahead_baselines": ahead, "ahead_sigma": sigma}
    others = _forward(neighbours)
    belongs = _belonging(directed, neighbours)
    figures |= {f"ahead_{name}": value for name, value in others.items()}
    if belongs is not None:
        late = belongs == "before"
        figures["frames_late"] = 1.0 if late else -1.0
        text = (
            f"the right picture of the frame {belongs} belongs to the left one: right pictures are "
            f"a frame too {'late' if late else 'early'}"
        )
        return Finding(SYNC, "warn", text, SUREST, MEND, figures)
    if not stands_ahead(rectified, directed):
        return _in_step(ahead, others, figures)
    sure = sure_beyond(abs(ahead), AHEAD / 2, sigma)
    side = "ahead of" if ahead > 0 else "behind"
    text = f"the right eye stands {abs(ahead):.2f} baselines {side} the left one"
    share = _share_of_a_frame(ahead, others)
    if share is not None:
        figures["frames_late"] = share
        text += f": it is about {abs(share):.1f} frames too {'late' if share > 0 else 'early'}"
        return Finding(SYNC, "warn", text, min(sure, ABOUT), MEND, figures)
    text += ": taken at another moment while the rig moved, or mounted so and not rectified"
    return Finding(SYNC, "warn", text, sure, MEND, figures)


def proved(finding: Finding) -> bool:
    """Whether other frames show that a pair is of two moments, and not of a rig mounted so."""
    return finding.severity == "warn" and "frames_late" in finding.figures


def _in_step(
    ahead: float, others: dict[str, float], figures: dict[str, float | int | None]
) -> Finding:
    driven = max((abs(value) for value in others.values()), default=0.0)
    if driven < MOVING:
        text = "cannot tell: " + (
            "the rig does not move" if others else "a pair alone shows only what moves a lot"
        )
        return Finding(SYNC, "unknown", text, None, "", figures)
    text = (
        f"in step: the right eye stands {abs(ahead):.2f} baselines off the left one's side, "
        f"{driven:.2f} a frame later"
    )
    return Finding(SYNC, "good", text, None, "", figures)


def _forward(neighbours: Neighbours | None) -> dict[str, float]:
    if neighbours is None:
        return {}
    fits = {"before": neighbours.before, "after": neighbours.after}
    return {name: fit.direction[1] for name, fit in fits.items() if fit is not None and enough(fit)}


def _belonging(pair: RowFit, neighbours: Neighbours | None) -> str | None:
    """The frame whose right picture fits the left one's rows, where its own does not."""
    if neighbours is None or pair.typical_px < STOP_PX:
        return None
    fits = {"before": neighbours.before, "after": neighbours.after}
    costs = {
        name: fit.cost
        for name, fit in fits.items()
        if fit is not None
        and enough(fit)
        and fit.typical_px < min(STOP_PX, BELONGS_PX * pair.typical_px)
    }
    best = min(costs, key=lambda name: costs[name], default=None)
    return best if best is not None and costs[best] < BELONGS * pair.cost else None


def _share_of_a_frame(ahead: float, others: dict[str, float]) -> float | None:
    """Frames by which the right picture is late, from the distance driven between frames."""
    steps = []
    if "after" in others:
        steps.append(others["after"] - ahead)
    if "before" in others:
        steps.append(ahead - others["before"])
    driven = sum(steps) / len(steps) if steps else 0.0
    return ahead / driven if abs(driven) > MOVING else None
