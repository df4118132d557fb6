"""The calibration doctor: is a pair what its rig says, and the rig what the pair says?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.calibration.check_epipolar import RowFit, fit_rows
from pseudolidar.calibration.check_exposure import exposure_found
from pseudolidar.calibration.check_eyes import EYES, SAME, eyes_found, same_found
from pseudolidar.calibration.check_finding import SEVERITIES, Finding, Severity
from pseudolidar.calibration.check_matches import PairMatches, match_points
from pseudolidar.calibration.check_rig import TRUTH, baseline_found, focal_found, truth_found
from pseudolidar.calibration.check_rows import ROWS, enough, rows_found
from pseudolidar.calibration.check_sync import SYNC, Neighbours, proved, stands_ahead, sync_found
from pseudolidar.calibration.drift import EyeRotation, RiggedMatches, eye_rotation
from pseudolidar.errors import NotRectified, PairSwapped, PseudolidarError
from pseudolidar.structures.arrays import Bool, Float64, Image
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import StereoFrame

# A pattern that repeats is matched anywhere: fewer matches than this agree with their neighbours.
# Of real and rendered pairs 0.99 and more do.
COHERENT = 0.7
# The direction from eye to eye is part of the picture where it explains it so much better.
EXPLAINED = 0.7


@dataclass(frozen=True, eq=False)
class PairCheck:
    """What one pair shows.

    Args:
        id: the source's name of the frame.
        findings: one for each thing that was looked at.
        matches: what was matched.
        inliers: (N,) matches that agree on how rows differ.
        rig: what the pair is said to be taken with.
        depths_px: (M,) disparities of what can be believed to be somewhere, whatever is to be said
            of rows: matches of nearly one row, on one surface with their neighbours.
        suspicious: a look at the frames before and after could explain it.
    """

    id: str
    findings: tuple[Finding, ...]
    matches: PairMatches
    inliers: Bool
    rig: StereoRig
    depths_px: Float64
    suspicious: bool = False

    @property
    def tells_rotation(self) -> bool:
        """Whether its rows show how its eyes are turned, and nothing else that was found."""
        severity = {finding.name: finding.severity for finding in self.findings}
        return severity[ROWS] in ("stop", "warn", "good") and severity[EYES] != "stop"


def check_pair(
    frame: StereoFrame,
    *,
    own_rig: StereoRig | None = None,
    before: Image | None = None,
    after: Image | None = None,
) -> PairCheck:
    """Look at everything that a rectified pair shows of its calibration.

    Args:
        frame: the pair.
        own_rig: the source's own rig, where another one replaces it.
        before: right picture of the frame before, where there is one.
        after: right picture of the frame after.
    """
    matches = match_points(frame.left, frame.right)
    rectified = fit_rows(matches, frame.rig, direction=False)
    directed = fit_rows(matches, frame.rig, direction=True)
    fit = _better(rectified, directed)
    inliers = np.zeros(len(matches), bool) if fit is None else fit.inliers
    agreeing = matches.selected(inliers)
    depths_px = agreeing.disparity_px[agreeing.coherent]
    if agreeing.coherence < COHERENT:
        matches = matches.selected(np.zeros(len(matches), bool))
        rectified = directed = fit = None
        inliers = np.zeros(0, bool)
    agreeing_px = matches.disparity_px[inliers]
    moves_px: Float64 = np.hypot(*(matches.right_px - matches.left_px).T)
    neighbours = Neighbours(*(_fit_with(frame, other) for other in (before, after)))
    looked = before is not None or after is not None
    found = [
        same_found(frame.left, frame.right, moves_px),
        eyes_found(agreeing_px, frame.rig.doffs_px),
        rows_found(fit, matches=len(matches)),
        sync_found(rectified, directed, neighbours if looked else None),
        baseline_found(frame.rig, agreeing_px),
        focal_found(frame.rig, own_rig),
        exposure_found(frame.left, frame.right, matches, inliers),
    ]
    if frame.truth is not None:
        found.append(truth_found(fit, frame.truth))
    findings = _explained(found)
    stops = any(finding.name == ROWS and finding.severity == "stop" for finding in findings)
    suspicious = not looked and (stops or stands_ahead(rectified, directed))
    return PairCheck(frame.id, findings, matches, inliers, frame.rig, depths_px, suspicious)


def combined(checks: Sequence[PairCheck]) -> tuple[Finding, ...]:
    """What several pairs of one source say together, one finding for each thing.

    What most of the pairs that can tell agree on counts; a fault of fewer is a warning.
    """
    names = dict.fromkeys(finding.name for check in checks for finding in check.findings)
    return tuple(_together(name, checks) for name in names)


def seen_rotation(checks: Sequence[PairCheck]) -> EyeRotation | None:
    """How the right eye is turned by all pairs that tell; None where too little is seen."""
    return eye_rotation(
        [
            RiggedMatches(check.matches.selected(check.inliers), check.rig)
            for check in checks
            if check.tells_rotation
        ]
    )


def stopping(findings: Sequence[Finding]) -> PseudolidarError | None:
    """The error of the first finding that stops a run; None if there is none."""
    for finding in findings:
        if finding.severity == "stop":
            kind, want = _ERRORS.get(finding.name, (NotRectified, "a rectified pair"))
            return kind(finding.seen, want=want, fix=finding.mend)
    return None


_ERRORS: dict[str, tuple[type[PseudolidarError], str]] = {
    EYES: (PairSwapped, "the left eye's picture on the left"),
    ROWS: (NotRectified, "rows that correspond to 1 px"),
}


def _better(rectified: RowFit | None, directed: RowFit | None) -> RowFit | None:
    if rectified is None or directed is None or not enough(directed):
        return rectified
    return directed if directed.cost < EXPLAINED * rectified.cost else rectified


def _fit_with(frame: StereoFrame, right: Image | None) -> RowFit | None:
    if right is None or right.shape != frame.right.shape:
        return None
    return fit_rows(match_points(frame.left, right), frame.rig, direction=True)


def _explained(found: Sequence[Finding]) -> tuple[Finding, ...]:
    """The findings without those that another one explains."""
    by_name = {finding.name: finding for finding in found}
    hidden: dict[str, str] = {}
    if by_name[SAME].severity == "warn":
        hidden = dict.fromkeys((EYES, ROWS, SYNC, TRUTH), "both pictures are the same")
    elif proved(by_name[SYNC]):
        hidden = dict.fromkeys((EYES, ROWS, TRUTH), "the eyes are not of one moment")
        if by_name[EYES].severity == "stop":
            del hidden[EYES]
    elif by_name[ROWS].severity == "stop" and by_name[EYES].severity == "warn":
        hidden = {EYES: "rows do not correspond"}
    if not hidden and by_name[ROWS].severity == "stop" and by_name[SYNC].severity == "warn":
        # Nothing proves that time is the cause, so the pair is what it looks like.
        rows = by_name[ROWS]
        found = [
            replace(rows, text=f"{rows.text}; {by_name[SYNC].text}") if f is rows else f
            for f in found
        ]
    return tuple(
        Finding(f.name, "note", f"cannot tell: {hidden[f.name]}") if f.name in hidden else f
        for f in found
    )


def _together(name: str, checks: Sequence[PairCheck]) -> Finding:
    found = [(check.id, f) for check in checks for f in check.findings if f.name == name]
    telling = [(id_, f) for id_, f in found if f.severity != "unknown"] or found
    worst = min((f.severity for _, f in telling), key=SEVERITIES.index)
    same = [(id_, f) for id_, f in telling if f.severity == worst]
    shown = max((f for _, f in same), key=lambda f: f.sure or 0.0)
    if len(checks) == 1:
        return shown
    severity: Severity = worst
    if worst == "stop" and 2 * len(same) <= len(telling):
        severity = "warn"
    if worst not in ("stop", "warn") and len(same) == len(found):
        return shown
    which = f"{len(same)} of {len(found)} pairs"
    if worst in ("stop", "warn") and len(same) < len(found):
        which += f" ({', '.join(id_ for id_, _ in same)})"
    return replace(shown, severity=severity, text=f"{shown.text}; {which}")
