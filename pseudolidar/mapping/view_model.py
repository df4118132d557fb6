"""A handful of pictures to where they were taken: matches by OpenCV, the rest by COLMAP."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import MissingDependency, OverlapInsufficient, SourceEmpty
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.geometry.twists import inverted
from pseudolidar.mapping.view_features import ViewFeatures, ViewPoints
from pseudolidar.structures.arrays import Float64, UInt8
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.views import SparseModel

FEWEST_VIEWS = 2
# Coordinates of COLMAP have the centre of the first pixel at (0.5, 0.5).
PIXEL_CENTRE = 0.5
# Points are kept where lines of sight meet at this angle, deg; the first two views must have so
# many points at a larger one.
LEAST_ANGLE_DEG = 1.0
BEGIN_ANGLE_DEG, BEGIN_POINTS = 2.0, 40
SEED = 0


@dataclass(frozen=True)
class ViewModel:
    """How views become a model.

    Args:
        features: points that are known again.
    """

    features: ViewFeatures = field(default_factory=ViewFeatures)

    def made(
        self,
        pictures: Mapping[str, UInt8],
        cameras: Mapping[str, Camera] | None,
        *,
        told: Callable[[], None] = lambda: None,
        keep: Path | None = None,
    ) -> SparseModel:
        """Find where pictures were taken.

        Args:
            pictures: (H, W) or (H, W, 3) by name, in order.
            cameras: of each by name, without distortion; None where nobody knows: then one
                focal length and one distortion are found for all of one size.
            told: called after each picture and pair.
            keep: folder for COLMAP's own text files of the model, which exists; None for none.

        Raises:
            MissingDependency: pycolmap is absent.
            SourceEmpty: fewer than two pictures.
            OverlapInsufficient: no two of them show the same from different places.
        """
        colmap = _library()
        if len(pictures) < FEWEST_VIEWS:
            raise SourceEmpty(f"{len(pictures)} pictures", want="two or more")
        points = {}
        for name, picture in pictures.items():
            points[name] = self.features.find(picture)
            told()
        with tempfile.TemporaryDirectory() as folder:
            work = Path(folder)
            _store(colmap, work, pictures, cameras)
            self._match(colmap, work, points, told)
            found = _solved(colmap, work, fixed=cameras is not None)
            if not found:
                raise _apart(points)
            largest = max(found.values(), key=_size)
            if keep is not None:
                largest.write_text(str(keep))
        return _from_first(_model(largest, tuple(pictures)))

    def _match(
        self,
        colmap: Any,
        work: Path,
        points: Mapping[str, ViewPoints],
        told: Callable[[], None],
    ) -> None:
        with contextlib.closing(colmap.Database.open(str(work / "db"))) as database:
            number = {name: database.read_image_with_name(_file(name)).image_id for name in points}
            for name, found in points.items():
                database.write_keypoints(number[name], found.uv + np.float32(PIXEL_CENTRE))
            for a, b in combinations(points, 2):
                pairs = self.features.match(points[a], points[b])
                database.write_matches(number[a], number[b], pairs)
                told()


def _library() -> Any:
    try:
        import pycolmap
    except ImportError as error:
        raise MissingDependency(
            f"pycolmap: {error}",
            want="the package pycolmap",
            fix='pip install "pseudolidar[reconstruct]"',
        ) from error
    pycolmap.logging.minloglevel = pycolmap.logging.Level.FATAL.value
    return pycolmap


def _store(
    colmap: Any, work: Path, pictures: Mapping[str, UInt8], cameras: Mapping[str, Camera] | None
) -> None:
    """Pictures as COLMAP reads them, and what is known of their cameras."""
    images = work / "images"
    images.mkdir()
    for name, picture in pictures.items():
        (images / _file(name)).write_bytes(encode_png(picture))
    database, names = str(work / "db"), [_file(name) for name in pictures]
    colmap.Database.open(database).close()  # which makes it
    if cameras is None:
        colmap.import_images(database, str(images), colmap.CameraMode.AUTO, image_names=names)
        return
    options = colmap.ImageReaderOptions(camera_model="PINHOLE")
    colmap.import_images(
        database, str(images), colmap.CameraMode.PER_IMAGE, image_names=names, options=options
    )
    with contextlib.closing(colmap.Database.open(database)) as opened:
        for name, camera in cameras.items():
            image = opened.read_image_with_name(_file(name))
            known = opened.read_camera(image.camera_id)
            K = camera.K
            known.params = [K[0, 0], K[1, 1], K[0, 2] + PIXEL_CENTRE, K[1, 2] + PIXEL_CENTRE]
            known.has_prior_focal_length = True
            opened.update_camera(known)


def _solved(colmap: Any, work: Path, *, fixed: bool) -> Mapping[int, Any]:
    verifier, two_views = colmap.GeometricVerifierOptions(), colmap.TwoViewGeometryOptions()
    verifier.num_threads, two_views.ransac.random_seed = 1, SEED
    colmap.set_random_seed(SEED)
    colmap.geometric_verification(
        str(work / "db"), verifier_options=verifier, two_view_geometry_options=two_views
    )
    options = colmap.IncrementalPipelineOptions()
    options.mapper.num_threads, options.mapper.random_seed = 1, SEED
    options.triangulation.random_seed = SEED
    options.min_model_size, options.multiple_models = FEWEST_VIEWS, False
    options.random_seed, options.num_threads = SEED, 1
    # COLMAP begins with views that see points at 16 degrees; of a handful there seldom are such.
    options.mapper.init_min_tri_angle = BEGIN_ANGLE_DEG
    options.mapper.init_min_num_inliers = BEGIN_POINTS
    options.mapper.init_max_forward_motion = 1.0  # a camera that drives looks ahead
    options.mapper.filter_min_tri_angle = options.triangulation.min_angle = LEAST_ANGLE_DEG
    options.ba_refine_focal_length = options.ba_refine_extra_params = not fixed
    options.mapper.abs_pose_refine_focal_length = not fixed
    options.mapper.abs_pose_refine_extra_params = not fixed
    (work / "sparse").mkdir()
    found: Mapping[int, Any] = colmap.incremental_mapping(
        str(work / "db"), str(work / "images"), str(work / "sparse"), options
    )
    return found


def _apart(points: Mapping[str, ViewPoints]) -> OverlapInsufficient:
    most = max(len(found.uv) for found in points.values())
    return OverlapInsufficient(
        f"{len(points)} pictures with at most {most} points each that fit to no scene",
        want="pictures that overlap by half or more, taken from different places",
        fix="Take pictures with more texture, closer together, and move between them, to turn "
        "alone is not enough; or tell the camera by --rig: two views alone do not.",
    )


def _size(model: Any) -> tuple[int, int]:
    return model.num_reg_images(), model.num_points3D()


def _model(found: Any, order: Sequence[str]) -> SparseModel:
    images = {image.name: image for image in found.images.values() if image.has_pose}
    names = tuple(name for name in order if _file(name) in images)
    poses, Ks = [], []
    for name in names:
        image = images[_file(name)]
        poses.append(_matrix(image.cam_from_world().inverse()))
        K = np.array(found.cameras[image.camera_id].calibration_matrix(), np.float64)
        K[:2, 2] -= PIXEL_CENTRE
        Ks.append(K)
    return SparseModel(
        names,
        np.stack(poses),
        _cloud(found),
        np.stack(Ks),
        float(found.compute_mean_reprojection_error()),
        tuple(name for name in order if name not in names),
    )


def _from_first(model: SparseModel) -> SparseModel:
    """In a world that is the first camera's place: x forward, y left, z up."""
    T_world_first = np.eye(4)
    T_world_first[:3, :3] = R_BODY_OPTICAL
    T = T_world_first @ inverted(model.T_world_camera[0])
    xyz = np.einsum("ij,nj->ni", T[:3, :3], model.points.xyz) + T[:3, 3]
    points = replace(model.points, xyz=xyz.astype(np.float32))
    return replace(model, T_world_camera=np.asarray(T @ model.T_world_camera), points=points)


def _matrix(rigid: Any) -> Float64:
    T = np.eye(4)
    T[:3] = rigid.matrix()
    return T


def _cloud(found: Any) -> PointCloud:
    points = list(found.points3D.values())
    return PointCloud(
        np.array([point.xyz for point in points], np.float32).reshape(-1, 3),
        "world",
        rgb=np.array([point.color for point in points], np.uint8).reshape(-1, 3),
        extra={
            "views": np.array([point.track.length() for point in points], np.int32),
            "error_px": np.array([point.error for point in points], np.float32),
        },
    )


def _file(name: str) -> str:
    """A file of a picture: names of users are not names of files."""
    return f"{name.encode().hex()}.png"
