"""What an opened source is: rig, frames, times, topics; with `deep` also what is in the frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.formats.pictures.image import read_header
from pseudolidar.running.crew.attempt import Done
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.describing.column_figures import CloudFigures, joined
from pseudolidar.running.describing.description import time_text
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.stream import stream
from pseudolidar.sources.cloud_files import CloudFileSource
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.folder_layout import find_layout
from pseudolidar.sources.source import KIND_NAMES, FrameSequence
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import LidarScan, StereoFrame
from pseudolidar.structures.recorded import DepthFrame, Frame, RecordedCloud

NS_PER_S = 1e9
# A step between frames this many times the usual one is a gap (the catalogue of faults, row 46).
GAP = 3.0
SYNTHETIC_TIME = "time: synthetic"


def source_facts(source: FrameSequence[Frame]) -> dict[str, Any]:
    """Frames, times and rig by what was opened; nothing is decoded."""
    return {
        "frames": {
            "count": len(source.ids),
            "yields": KIND_NAMES[source.yields],
            "first": source.ids[0] if source.ids else None,
            "last": source.ids[-1] if source.ids else None,
            "refused": [{"id": name, **error.as_dict()} for name, error in source.refused],
        },
        "times": time_facts(
            source.timestamps_ns,
            source.ids,
            synthetic=any(SYNTHETIC_TIME in note for note in source.summary.notes),
        ),
        "rig": None if source.rig is None else rig_facts(source.rig),
        **(_cloud_facts(source) if isinstance(source, CloudFileSource) else {}),
    }


def time_facts(
    timestamps_ns: Sequence[int], names: Sequence[str], *, synthetic: bool = False
) -> dict[str, Any]:
    """Span, rate and gaps of times."""
    times = np.asarray(timestamps_ns, np.int64)
    steps = np.diff(times)
    usual_ns = float(np.median(steps)) if len(steps) else 0.0
    long = np.flatnonzero(steps > GAP * usual_ns).tolist() if usual_ns > 0 else []
    return {
        "synthetic": synthetic,
        "first": time_text(int(times[0])) if len(times) else None,
        "last": time_text(int(times[-1])) if len(times) else None,
        "first_s": float(times[0] / NS_PER_S) if len(times) else None,
        "last_s": float(times[-1] / NS_PER_S) if len(times) else None,
        "span_s": float((times[-1] - times[0]) / NS_PER_S) if len(times) else 0.0,
        "rate_hz": NS_PER_S / usual_ns if usual_ns > 0 else None,
        "gaps": [{"after": names[i], "seconds": float(steps[i] / NS_PER_S)} for i in long],
    }


def rig_facts(rig: StereoRig) -> dict[str, Any]:
    """Figures of a rig."""
    mounted = {
        "velodyne": rig.T_left_velodyne is not None,
        "imu": rig.T_left_velodyne is not None and rig.T_velodyne_imu is not None,
    }
    at_1_px = 1.0 + rig.doffs_px
    return {
        "f_px": rig.left.focal_px,
        "baseline_m": rig.baseline_m,
        "metric": rig.metric,
        "fB_px_m": rig.fB_px_m,
        "depth_at_1_px_m": rig.fB_px_m / at_1_px if at_1_px > 0 else None,
        "doffs_px": rig.doffs_px,
        "width_px": rig.left.width_px,
        "height_px": rig.left.height_px,
        "rectified": rig.is_rectified,
        "corrected": rig.correction is not None,
        "rows_corrected": rig.rows is not None,
        "systematic_sigma_px": rig.systematic_sigma_px,
        "frames": [rig.left.frame, rig.right.frame, *(n for n, there in mounted.items() if there)],
        "origin": rig.origin,
    }


def unusable_pairs(settings: Folders) -> dict[str, Any]:
    """What pictures without calibration tell."""
    layout = find_layout(Path(settings.path), tolerance_s=settings.tolerance_s)
    if layout is None:
        return {}
    pairs, pairing = layout.pairing.pairs, layout.pairing
    header = read_header(pairs[0].left)
    return {
        "frames": {
            "count": len(pairs),
            "yields": f"pairs of pictures ({layout.line}: {pairing.rule})",
            "first": pairs[0].key,
            "last": pairs[-1].key,
            "refused": [],
        },
        "pictures": {"width_px": header.width_px, "height_px": header.height_px},
    }


def _cloud_facts(source: CloudFileSource) -> dict[str, Any]:
    """Columns and number of points of the first file, by its header."""
    if not source.files:
        return {}
    path = Path(source.files[0])
    facts = source.reading.format_of(path).facts(path)
    found: dict[str, Any] = {"points": facts.points, "encoding": facts.encoding}
    if facts.frame:
        found["coordinate_frame"] = facts.frame
    if facts.shape:
        found["shape"] = list(facts.shape)
    found |= {f"{name}s": count for name, count in facts.others}
    columns = [{"name": name, "dtype": dtype} for name, dtype in facts.columns]
    return {"first_file": found, "columns": columns}


# --- deep -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FrameLook:
    """What is in a frame.

    Args:
        cloud: figures of its cloud, or of its scan.
        counts: 1 for each thing that it has.
    """

    cloud: CloudFigures | None
    counts: dict[str, int] = field(default_factory=dict)


def look_at(frame: Frame) -> FrameLook:
    """Figures of a frame."""
    match frame:
        case RecordedCloud():
            scan = {"scan": 1} if frame.scan is not None else {}
            return FrameLook(CloudFigures.of(frame.cloud), scan | _noted(frame))
        case DepthFrame():
            share = {"depth_known": int(frame.depth.valid.sum()), "pixels": frame.depth.values.size}
            return FrameLook(None, share | _noted(frame))
        case StereoFrame():
            there: dict[str, object] = {"scan": frame.scan, "labels": frame.labels}
            there |= {"pose": frame.pose, "ground_truth_disparity": frame.truth}
            counts = {name: 1 for name, value in there.items() if value is not None}
            counts |= {"labelled_objects": len(frame.labels)} if frame.labels else {}
            return FrameLook(_of_scan(frame.scan), counts | _noted(frame))
        case BodyFrame():
            counts = {f"pair {name}": 1 for name in frame.pairs}
            return FrameLook(_of_scan(frame.scan), counts | _noted(frame))


def _noted(frame: Frame) -> dict[str, int]:
    return {f"note: {note}": 1 for note in frame.notes}


def _of_scan(scan: LidarScan | None) -> CloudFigures | None:
    if scan is None:
        return None
    return CloudFigures.of(PointCloud(scan.xyz, scan.frame, intensity=scan.reflectance))


def deep_facts(source: FrameSequence[Frame], *, workers: int | None) -> dict[str, Any]:
    """Figures of every frame, each of them read; those that cannot be are named."""
    counts: dict[str, int] = {}
    clouds: list[CloudFigures] = []
    bad: list[dict[str, Any]] = []
    good = 0
    with FrameProgress(len(source.ids)) as progress:
        for outcome in stream(source, look_at, crew=CrewPlan(workers)):
            if not isinstance(outcome, Done):
                bad.append({"id": outcome.id, **outcome.error.as_dict()})
                progress.skip()
                continue
            good += 1
            progress.advance()
            clouds += [] if outcome.value.cloud is None else [outcome.value.cloud]
            for name, count in outcome.value.counts.items():
                counts[name] = counts.get(name, 0) + count
    total = joined(clouds)
    pixels, known = counts.pop("pixels", 0), counts.pop("depth_known", 0)
    figures: dict[str, Any] = {"frames_with": counts or None}
    figures |= {"depth_known_share": known / pixels} if pixels else {}
    figures |= {} if total is None else total.as_dict()
    return {
        "read": {"good": good, "bad": len(bad)},
        "bad_frames": [f"{item['id']} ({item['code']}: {item['got']})" for item in bad],
        "figures": figures,
    }
