"""A handful of pictures to where they were taken, and the points that they share."""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np

from pseudolidar.clouds.merge import Joined
from pseudolidar.errors import (
    CalibrationField,
    OverlapInsufficient,
    PseudolidarError,
    UsageError,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.geometry.twists import rigid
from pseudolidar.mapping.view_model import ViewModel
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY, THIS_TIME
from pseudolidar.running.folder import check_usable
from pseudolidar.running.mapped.views import (
    CameraDistance,
    Views,
    pictures_in,
    views_of_folder,
    views_of_pairs,
)
from pseudolidar.running.matching import MatchFrame, Refining
from pseudolidar.running.one_cloud import write_cloud
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.reports.views_report import ReconstructReport, page_of
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.rectified import Rectify
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import FrameSource, pairs_of, tell
from pseudolidar.stereo.balance import BalanceWhen
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.eyes import Eyes
from pseudolidar.stereo.filters.clean import Clean
from pseudolidar.stereo.neural import Onnx
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.stereo.row_alignment import RowsWhen
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.views import SparseModel

_log = logging.getLogger(__name__)

SPARSE_NAME, DENSE_NAME, CAMERAS_NAME, PAGE_NAME = (
    "points.ply", "dense.ply", "cameras.json", "report.html",
)  # fmt: skip
COLMAP_FOLDER = "colmap"
# Two lengths of the same baseline may differ by this share before they are told to.
BASELINES_DIFFER = 0.05


@dataclass(frozen=True)
class Reconstruct:
    """Find where a handful of pictures were taken, and the points that they share.

    For pictures without order, without stereo, or of which nobody knows the poses; of sequences of
    pairs `map` makes more. Points are known again by SIFT or ORB; COLMAP (pycolmap, of the extra
    `reconstruct`) finds poses, points and, unless --rig tells it, the focal length. Lengths are
    metres where pairs of a rig or --distance tell them, else of no unit, and that is said.

        pseudolidar reconstruct photos out/statue
        pseudolidar reconstruct photos out/statue --distance IMG_01.jpg,IMG_05.jpg=1.20
        pseudolidar reconstruct KITTI/training out/pairs --frames 0:2

    OUT/points.ply has the points with colour, views and error; OUT/cameras.json where pictures
    were taken, in a world that begins at the first (x forward, y left, z up); OUT/colmap COLMAP's
    own text files; OUT/dense.ply, of pairs, their clouds in that world; OUT/report.html shows it.

    Args:
        images: folder of pictures, or a source of pairs: KITTI data, folders, synthetic:NAME.
        out: folder for the results.
        model: points that are looked for: --model.features.kind orb.
        distance: how far two pictures were taken from one another, m: a.jpg,b.jpg=0.35.
        rig: calibration: of single pictures its left camera is theirs.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        matcher: how disparities of pairs are found, for the dense cloud.
        rows: bring the rows of the right picture to those of the left one before matching: `auto`
            where points that both eyes see show that they differ, `never`.
        balance: give the right picture the brightness, colours, gamma and vignetting of the left
            one before matching: `auto`, `always`, `never`.
        voxel: one point of the dense cloud in each cube with this edge, m.
        frames: of pairs only these: slices 0::10, ids 13,35.
        overwrite: replace what OUT holds.
    """

    images: Annotated[str, POSITIONAL]
    out: Annotated[Path, POSITIONAL, RUN_ONLY] = Path("out")
    model: ViewModel = field(default_factory=ViewModel)
    distance: CameraDistance | None = None
    rig: Path | None = None
    rig_unit: RigUnit | None = None
    matcher: Census | Sgbm | Bm | Onnx = field(default_factory=Census)
    rows: RowsWhen = "auto"
    balance: BalanceWhen = "auto"
    voxel: float = 0.02
    frames: FrameSelection | None = None
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False


def run(job: Reconstruct) -> ReconstructReport:
    """Read the pictures, find poses and points, make them metres, join the pairs' clouds.

    Raises:
        MissingDependency: pycolmap is absent.
        SourceEmpty: fewer than two pictures, or too many.
        OverlapInsufficient: they do not show the same from different places.
        UsageError: OUT holds something else.
    """
    check_usable(job.out)
    if (job.out / CAMERAS_NAME).exists() and not job.overwrite:
        raise UsageError(
            "there is a result already", want="a new folder", fix="Pass --overwrite.", path=job.out
        )
    source, views, bad = viewed(job)
    n = len(views.pictures)
    colmap = job.out / COLMAP_FOLDER
    colmap.mkdir(parents=True, exist_ok=True)
    with FrameProgress(n + n * (n - 1) // 2) as progress:
        model = job.model.made(views.pictures, views.cameras, told=progress.advance, keep=colmap)
    model, notes = in_metres(model, views, job.distance)
    dense = None if source is None or not model.scaled else dense_cloud(job, source, views, model)
    files = stored(job.out, model, dense)
    report = ReconstructReport(job.out, model, dense, notes, bad, files)
    write_atomic(job.out / PAGE_NAME, page_of(report))
    return report


def viewed(job: Reconstruct) -> tuple[FrameSource | None, Views, tuple[str, ...]]:
    """Both eyes of pairs, where there are calibrated ones; else the pictures of the folder.

    Raises:
        PseudolidarError: neither.
    """
    try:
        source = pairs_in(job)
    except PseudolidarError:
        place = Path(job.images)
        if not place.is_dir() or not pictures_in(place):
            raise
        camera = None if job.rig is None else left_camera(job.rig, job)
        views, bad = views_of_folder(place, camera)
        _log.info("%s: %d pictures", place, len(views.pictures))
        return None, views, bad
    tell(source)
    return source, views_of_pairs(source), ()


def pairs_in(job: Reconstruct) -> FrameSource:
    """The rectified pairs of a source.

    Raises:
        PseudolidarError: it is none, or has none.
    """
    every = opened_with_rig(
        recognise(job.images),
        job.rig,
        scale_calibration=False,
        unit=job.rig_unit,
        swap=False,
        rectify=Rectify(),
    )
    return pairs_of(select(every, job.frames, None))


def left_camera(rig: Path, job: Reconstruct) -> Camera:
    """The left camera of a calibration.

    Raises:
        CalibrationField: it has a lens that bends lines.
    """
    reading = read_any_rig(rig, unit=job.rig_unit)
    found = reading.rectified or reading.raw
    if found is None or found.left.distortion.any():
        raise CalibrationField(
            "no camera, or a lens that bends lines",
            want="the camera of rectified pictures",
            fix="Rectify the pictures first, or leave out --rig: the focal length is found then.",
            path=rig,
        )
    return found.left


def in_metres(
    model: SparseModel, views: Views, distance: CameraDistance | None
) -> tuple[SparseModel, tuple[str, ...]]:
    """The model in metres, by what is known of its cameras; and what is odd about that.

    Raises:
        UsageError: the distance is of pictures that are not in the model.
    """
    if distance is not None:
        for name in (distance.first, distance.second):
            if name not in model.names:
                raise UsageError(
                    f"--distance of {name!r}, which is in no model",
                    want=", ".join(model.names[:9]),
                    where="--distance",
                )
        return model.times(distance.metres / model.distance(distance.first, distance.second)), ()
    baselines = [
        model.distance(left, right)
        for left, right in views.pairs.values()
        if left in model.names and right in model.names
    ]
    if views.baseline_m is None or not baselines:
        return model, ("its lengths have no unit: --distance a.jpg,b.jpg=0.35 makes them metres",)
    spread = float(np.ptp(baselines) / np.median(baselines))
    odd = (f"baselines of pairs differ by {spread:.1%}",) if spread > BASELINES_DIFFER else ()
    return model.times(views.baseline_m / float(np.median(baselines))), odd


def dense_cloud(
    job: Reconstruct, source: FrameSource, views: Views, model: SparseModel
) -> PointCloud:
    """The clouds of all pairs that are in the model, in its world.

    Raises:
        OverlapInsufficient: not one left picture is in the model.
    """
    eyes = Eyes(job.rows, job.balance)
    match = MatchFrame.load(source, job.matcher, Refining(), Clean(), eyes=eyes)
    reproject, joined = Reproject().load(), Joined(job.voxel)
    for index, name in enumerate(source.ids):
        left, _ = views.pairs[name]
        if left not in model.names:
            continue
        frame = source.load(index)
        try:
            cloud = reproject(frame, match.disparity(frame))
        except PseudolidarError as error:
            _log.warning("dense: %s left out: %s", name, error)
            continue
        T = model.T_world_camera[model.names.index(left)]
        joined.add(cloud.transformed(Pose("world", cloud.frame, rigid(T))))
    if not len(joined):
        raise OverlapInsufficient("no pair with a cloud", want="pairs that can be matched")
    return joined.taken()[0]


def stored(out: Path, model: SparseModel, dense: PointCloud | None) -> tuple[Path, ...]:
    """Write points, cameras, and the dense cloud where there is one."""
    out.mkdir(parents=True, exist_ok=True)
    files = [out / SPARSE_NAME, out / CAMERAS_NAME]
    write_cloud(files[0], model.points)
    cameras = [
        {"name": name, "K": K.tolist(), "T_world_camera": T.tolist()}
        for name, K, T in zip(model.names, model.K, model.T_world_camera, strict=True)
    ]
    told = {"schema": 1, "metres": model.scaled, "error_px": model.error_px, "cameras": cameras}
    write_atomic(files[1], (json.dumps(told, indent=1) + "\n").encode())
    if dense is not None:
        files.append(out / DENSE_NAME)
        write_cloud(files[-1], dense)
    return (*files, out / COLMAP_FOLDER, out / PAGE_NAME)
