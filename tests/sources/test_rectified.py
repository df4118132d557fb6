"""Unrectified pairs through every way that loads them, against worlds whose depth is exact."""

from __future__ import annotations

import itertools
import pickle
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from pseudolidar.errors import CalibrationSizeMismatch, NoPairs, NotRectified, UsageError
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.geometry.frames import BASE_LINK, MAP, left_in_base_link
from pseudolidar.geometry.rectification import aligning_rotations
from pseudolidar.geometry.rectified_pixels import unmasked
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.other_rig import opened_with_rig, with_rig
from pseudolidar.sources.rectified import Rectify, exchanged, in_one_view, raw_rig, rectified
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import pairs_of
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.correction import RowCorrection
from pseudolidar.structures.frame import LidarScan, RawPair, StereoFrame
from pseudolidar.structures.image_size import ImageSize
from pseudolidar.structures.motion import BodyMotion
from pseudolidar.structures.pose import Pose
from tests.lens_worlds import T_world_left, raw_pair, true_depth, true_ranges, world_rig

MATCH = Census().load(min_depth_m=0.5)


@pytest.fixture(scope="module")
def pinhole() -> RawPair:
    """12 coefficients, thin prism among them."""
    return raw_pair(world_rig("pinhole", focal_px=320.0))


@pytest.fixture(scope="module")
def fisheye() -> RawPair:
    """180 degrees across, round in its picture."""
    return raw_pair(world_rig("fisheye", focal_px=115.0))


def stored(pair: RawPair, folder: Path) -> Path:
    """The pair in a folder with its rig."""
    for name, picture in (("left", pair.left), ("right", pair.right)):
        (folder / name).mkdir(parents=True)
        (folder / name / "000000.png").write_bytes(encode_png(picture))
    write_rig(folder / "rig.json", pair.rig)
    return folder


def errors_px(frame: StereoFrame, rectify: Rectify, raw: RawPair) -> np.ndarray:
    """(H, W) error of the disparities found, NaN where there are none."""
    (planned,) = rectify.plans(raw.rig)
    truth = frame.rig.fB_px_m / true_depth(planned) - frame.rig.doffs_px
    return unmasked(MATCH(frame), frame.mask).values - truth


@pytest.mark.parametrize("lens", ["pinhole", "fisheye"])
@pytest.mark.parametrize("alpha", [0.0, 1.0])
def test_clouds_of_raw_pairs_are_where_the_world_is(
    lens: str, alpha: float, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    raw, rectify = request.getfixturevalue(lens), Rectify(alpha=alpha)
    source = opened_with_rig(Folders(str(stored(raw, tmp_path))), None, rectify=rectify)
    frame = pairs_of(source).load(0)
    error = errors_px(frame, rectify, raw)
    found = np.isfinite(error)
    seen = np.ones(found.shape, bool) if frame.mask is None else frame.mask.left
    assert found[seen].mean() > 0.85
    assert not found[~seen].any()
    assert np.median(np.abs(error[found])) < 0.16
    assert abs(np.median(error[found])) < 0.03  # a shift of the maps would show here
    assert np.mean(np.abs(error[found]) > 1) < 0.09
    (note,) = [note for note in source.summary.notes if note.startswith("rectified")]
    assert f"{lens} lenses" in note
    assert f"alpha {alpha:g}" in note


def test_borders_of_what_was_seen_are_as_good_as_the_middle(pinhole: RawPair) -> None:
    rectify = Rectify(alpha=1.0)
    frame = rectified(pinhole, rectify)
    error = errors_px(frame, rectify, pinhole)
    whole = MATCH(frame).values
    lost = np.isfinite(whole) & ~np.isfinite(error)
    assert lost.mean() > 0.03  # matched black with black
    distance = cv2.distanceTransform(frame.mask.left.astype(np.uint8), cv2.DIST_L2, 5)
    found = np.isfinite(error)
    border, middle = found & (distance < 6), found & (distance >= 20)
    bad = np.abs(error) > 1
    assert bad[border].mean() < 2 * bad[middle].mean() + 0.01


def halved(picture: np.ndarray) -> np.ndarray:
    height, width = picture.shape[:2]
    return cv2.resize(picture, (width // 2, height // 2), interpolation=cv2.INTER_AREA)


def test_resized_pictures_need_scale_calibration(pinhole: RawPair, tmp_path: Path) -> None:
    folder = stored(pinhole, tmp_path)
    for eye, picture in (("left", pinhole.left), ("right", pinhole.right)):
        (folder / eye / "000000.png").write_bytes(encode_png(halved(picture)))
    with pytest.raises(CalibrationSizeMismatch, match="--scale-calibration"):
        opened_with_rig(Folders(str(folder)), None)
    frame = pairs_of(opened_with_rig(Folders(str(folder)), None, scale_calibration=True)).load(0)
    assert frame.size_px == (240, 180)
    small = RawPair(
        halved(pinhole.left), halved(pinhole.right), pinhole.rig.scaled_to(240, 180), "", 0, 1
    )
    error = errors_px(frame, Rectify(), small)
    assert abs(np.nanmedian(error)) < 0.03
    assert np.nanmedian(np.abs(error)) < 0.13


def test_eyes_of_two_sizes(pinhole: RawPair, tmp_path: Path) -> None:
    right = pinhole.rig.scaled_to(240, 180).right
    rig = replace(pinhole.rig, right=right)
    mixed = RawPair(pinhole.left, halved(pinhole.right), rig, "000000", 0, 1_000_000_000)
    source = opened_with_rig(Folders(str(stored(mixed, tmp_path))), None)
    frame = pairs_of(source).load(0)
    assert frame.left.shape == frame.right.shape
    error = errors_px(frame, Rectify(), mixed)
    assert abs(np.nanmedian(error)) < 0.05
    assert np.nanmedian(np.abs(error)) < 0.2  # the right eye has half the resolution
    (tmp_path / "right" / "000000.png").write_bytes(encode_png(pinhole.right))
    with pytest.raises(CalibrationSizeMismatch, match="480x360"):
        opened_with_rig(Folders(str(tmp_path)), None).load(0)


def test_exchanged_pictures_are_put_right_before(pinhole: RawPair, tmp_path: Path) -> None:
    exchanged = replace(pinhole, left=pinhole.right, right=pinhole.left)
    folder = stored(exchanged, tmp_path)
    frame = opened_with_rig(Folders(str(folder)), None, swap=True).load(0)
    np.testing.assert_array_equal(frame.left, rectified(pinhole, Rectify()).left)


def test_several_views_show_all_that_a_fisheye_sees(fisheye: RawPair) -> None:
    body = rectified(fisheye, Rectify(views=3))
    assert isinstance(body, BodyFrame)
    # Directions of base_link in the left camera as it is.
    optical = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    turned = optical @ aligning_rotations(fisheye.rig.T_right_left)[0]
    reproject = Reproject().load()
    heights: list[np.ndarray] = []
    errors_px: list[np.ndarray] = []
    for name, pair in body.pairs.items():
        cloud = reproject(pair, unmasked(MATCH(pair), pair.mask))
        points = cloud.transformed(body.T_base_link_left[name]).xyz.astype(np.float64)
        distance = np.linalg.norm(points, axis=1)
        truth = true_ranges(points @ turned, T_world_left(0.0))
        # Relative errors grow with the distance; this one is of the disparity.
        error_px = pair.rig.fB_px_m / np.hypot(points[:, 0], points[:, 2]) * (1 - distance / truth)
        assert np.nanmedian(np.abs(error_px)) < 0.2
        assert abs(np.nanmedian(error_px)) < 0.05
        heights.append(np.rad2deg(np.arctan2(-points[:, 2], points[:, 0])))
        errors_px.append(error_px)
    # From above over ahead to below, and each direction once.
    assert heights[0].min() < -80
    assert heights[2].max() > 80
    for above, below in itertools.pairwise(heights):
        assert abs(below.min() - above.max()) < 0.5  # pixels there are 0.4 degrees high
    # A surface that goes on from one view to the next has no step.
    for number, (above, below) in enumerate(itertools.pairwise(heights)):
        edge = (above.max() + below.min()) / 2
        over = np.nanmedian(errors_px[number][above > edge - 4])
        under = np.nanmedian(errors_px[number + 1][below < edge + 4])
        assert abs(over - under) < 0.1


def test_views_are_another_kind_of_frame_with_one_view_for_who_needs_it(
    fisheye: RawPair, tmp_path: Path
) -> None:
    folder = Folders(str(stored(fisheye, tmp_path)))
    source = opened_with_rig(folder, None, rectify=Rectify(views=2))
    assert source.yields is BodyFrame
    assert isinstance(source.load(0), BodyFrame)
    with pytest.raises(NoPairs, match=r"leave --rectify\.views out"):
        pairs_of(source)
    flat = in_one_view(source)
    assert flat.yields is StereoFrame
    plain = opened_with_rig(folder, None)
    np.testing.assert_array_equal(flat.load(0).left, plain.load(0).left)
    assert "--rectify.views 3" in plain.summary.notes[-1]
    with pytest.raises(UsageError, match="1 to 9"):
        opened_with_rig(folder, None, rectify=Rectify(views=10))


def test_a_source_loads_the_same_after_pickling_and_tells_its_raw_rig(
    pinhole: RawPair, tmp_path: Path
) -> None:
    size = ImageSize(320, 240)
    source = opened_with_rig(
        Folders(str(stored(pinhole, tmp_path))), None, rectify=Rectify(zoom=1.2, size=size)
    )
    again = pickle.loads(pickle.dumps(source)).load(0)
    frame = source.load(0)
    assert frame.size_px == (320, 240)
    np.testing.assert_array_equal(frame.left, again.left)
    assert raw_rig(source).left.distortion.tolist() == pinhole.rig.left.distortion.tolist()
    assert source.rig.is_rectified


def test_the_body_turns_with_the_left_camera_unless_it_is_another_sensor(pinhole: RawPair) -> None:
    """A point that stands still in the map does so by the poses before and after."""
    matrix = np.eye(4)
    matrix[:3, :3] = cv2.Rodrigues(np.array([0.1, 0.2, 0.3]))[0]
    matrix[:3, 3] = 1.0, 2.0, 0.5
    pair = replace(pinhole, pose=Pose(MAP, BASE_LINK, matrix))
    frame = rectified(pair, Rectify())
    R_left = aligning_rotations(pair.rig.T_right_left)[0]
    optical = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    turn = np.eye(4)
    turn[:3, :3] = optical @ R_left @ optical.T
    np.testing.assert_allclose(frame.pose.matrix, turn @ matrix @ turn.T, atol=1e-12)
    lidar = Pose("camera_left", "velodyne", np.eye(4))
    mounted = replace(pair, rig=replace(pair.rig, T_left_velodyne=lidar))
    assert rectified(mounted, Rectify()).pose is pair.pose


def test_a_moving_body_moves_on_as_it_did(pinhole: RawPair) -> None:
    """By motion from the pose before to the pose after, with the left camera as the body."""
    twist, step_s = np.array([4.0, 0.5, -0.2, 0.1, -0.3, 0.6]), 0.05
    motion = BodyMotion(BASE_LINK, twist[:3], twist[3:])
    start = exp_twist(np.array([1.0, 2.0, 0.5, 0.1, 0.2, 0.3]))
    before, after = (
        rectified(replace(pinhole, pose=Pose(MAP, BASE_LINK, matrix), motion=motion), Rectify())
        for matrix in (start, start @ exp_twist(step_s * twist))
    )
    assert before.motion.frame == BASE_LINK
    moved = np.concatenate([before.motion.velocity_m_s, before.motion.rate_rad_s])
    by_motion = before.pose.matrix @ exp_twist(step_s * moved)
    np.testing.assert_allclose(after.pose.matrix, by_motion, atol=1e-12)
    # A point of the world is one point of the map, whichever frame it is seen in.
    R_left = aligning_rotations(pinhole.rig.T_right_left)[0]
    seen = np.array([[0.3, -0.2, 4.0], [-1.0, 0.5, 9.0]])
    T_base_left = left_in_base_link(pinhole.rig)
    T_left_left = T_base_left.inverse().matrix @ exp_twist(-step_s * twist) @ T_base_left.matrix
    later = seen @ T_left_left[:3, :3].T + T_left_left[:3, 3]
    in_map = [
        (frame.pose @ left_in_base_link(frame.rig)).apply(points @ R_left.T)
        for frame, points in ((before, seen), (after, later))
    ]
    np.testing.assert_allclose(in_map[0], in_map[1], atol=1e-12)


def with_lidar(pair: RawPair) -> RawPair:
    """The pair with a scan of a LiDAR above it, a motion and a note."""
    matrix = np.eye(4)
    matrix[:3, :3] = [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]
    matrix[:3, 3] = 0.1, -0.3, 0.2
    lidar = Pose("camera_left", "velodyne", matrix)
    return replace(
        pair,
        rig=replace(pair.rig, T_left_velodyne=lidar),
        scan=LidarScan(np.array([[4.0, 1.0, -0.5]], np.float32), None, "velodyne", 5),
        motion=BodyMotion("velodyne", np.array([10.0, 0, 0]), np.zeros(3)),
        notes=("a note",),
    )


def test_a_scan_stays_beside_the_pair_where_it_was(pinhole: RawPair) -> None:
    pair = with_lidar(pinhole)
    frame = rectified(pair, Rectify())
    assert frame.scan is pair.scan
    assert frame.motion is pair.motion
    assert frame.notes == ("a note",)
    in_left = pair.rig.T_left_velodyne.apply(pair.scan.xyz)
    in_rectified = frame.rig.T_left_velodyne.apply(pair.scan.xyz)
    R_left = aligning_rotations(pair.rig.T_right_left)[0]
    np.testing.assert_allclose(in_rectified, in_left @ R_left.T, atol=1e-6)


def test_a_scan_stays_beside_the_views_where_it_was(fisheye: RawPair) -> None:
    pair = with_lidar(fisheye)
    body = rectified(pair, Rectify(views=2))
    assert body.scan is pair.scan
    assert body.notes == ("a note",)
    assert all(view.notes == () for view in body.pairs.values())
    on_body = body.T_base_link_lidar.apply(pair.scan.xyz)
    for name, view in body.pairs.items():
        in_view = view.rig.T_left_velodyne.apply(pair.scan.xyz)
        by_view = body.T_base_link_left[name].apply(in_view)
        np.testing.assert_allclose(by_view, on_body, atol=1e-6)


def test_each_view_is_a_source_of_its_own(fisheye: RawPair, tmp_path: Path) -> None:
    rectify = Rectify(views=2, size=ImageSize(200, 150))
    source = opened_with_rig(Folders(str(stored(fisheye, tmp_path))), None, rectify=rectify)
    body = source.load(0)
    assert tuple(source.parts) == tuple(body.pairs) == ("view_0", "view_1")
    for name, part in source.parts.items():
        view = part.load(0)
        assert part.yields is StereoFrame
        np.testing.assert_array_equal(view.left, body.pairs[name].left)
        np.testing.assert_array_equal(part.rig.P_left, view.rig.P_left)
        assert view.size_px[0] == 200  # the width; the height follows from what is seen
    upper, lower = (part.load(0).left for part in source.parts.values())
    assert not np.array_equal(upper, lower)


def test_pairs_can_be_exchanged_before_they_are_rectified(pinhole: RawPair, tmp_path: Path) -> None:
    source = opened_with_rig(Folders(str(stored(pinhole, tmp_path))), None)
    want = rectified(replace(pinhole, left=pinhole.right, right=pinhole.left), Rectify())
    for every in (source, select(source, FrameSelection.parse("0"), None)):
        got = exchanged(every).load(0)
        np.testing.assert_array_equal(got.left, want.left)
        np.testing.assert_array_equal(got.right, want.right)


def test_the_note_says_what_is_shown(pinhole: RawPair, tmp_path: Path) -> None:
    source = opened_with_rig(Folders(str(stored(pinhole, tmp_path))), None)
    K = source.rig.left.K
    ends = np.array([[0.0, 0.0, 1.0], [479.0, 359.0, 1.0]]) @ np.linalg.inv(K).T
    wide, high = np.rad2deg(np.arctan(ends[1, :2]) - np.arctan(ends[0, :2]))
    (note,) = [note for note in source.summary.notes if note.startswith("rectified")]
    assert f"to 480x360 px, f {K[0, 0]:.1f} px, {wide:.0f} x {high:.0f} deg" in note


@pytest.mark.parametrize("half_deg", [75.0, 100.0])
def test_what_a_wide_lens_sees_beside_its_pictures_is_told(half_deg: float, tmp_path: Path) -> None:
    """Round pictures of a lens without distortion: as wide as high, also beyond 180 degrees."""
    across_px = 481
    middle = (across_px - 1) / 2
    focal = middle / np.deg2rad(half_deg)
    K = np.array([[focal, 0, middle], [0, focal, middle], [0, 0, 1]])
    left = Camera(K, across_px, across_px, np.zeros(4), "fisheye")
    shift = Pose.from_rotation("camera_right", "camera_left", np.eye(3), np.array([-0.1, 0, 0]))
    rig = StereoRig(left, replace(left, frame="camera_right"), shift)
    black = np.zeros((across_px, across_px), np.uint8)
    folder = Folders(str(stored(RawPair(black, black, rig, "000000", 0, 1), tmp_path)))

    def said(rectify: Rectify) -> str:
        notes = opened_with_rig(folder, None, rectify=rectify).summary.notes
        return next(note for note in notes if note.startswith("rectified"))

    seen = f"the lenses see {2 * half_deg:.0f} deg of"
    assert f"{seen} height: --rectify.views 3" in said(Rectify())
    assert f"{seen} width, the sides are left out: --rectify.field-deg 150" in said(Rectify())
    assert f"{seen} width" in said(Rectify(views=3))
    widest = said(Rectify(views=3, field_deg=150.0))
    assert ("the sides are left out" in widest) == (half_deg > 90)
    assert "--rectify.field-deg" not in widest


def test_pictures_that_are_said_to_be_rectified_are_not_bent(
    pinhole: RawPair, tmp_path: Path
) -> None:
    folder = Folders(str(stored(pinhole, tmp_path)))
    with pytest.raises(NotRectified, match="unrectified cameras"):
        opened_with_rig(folder, None, rectify=Rectify(pictures="rectified"))


def test_a_calibration_that_knows_both_takes_pictures_for_rectified_unless_told(
    pinhole: RawPair, tmp_path: Path
) -> None:
    folder = stored(pinhole, tmp_path)
    (folder / "rig.json").unlink()
    rig, plan = pinhole.rig, Rectify().plans(pinhole.rig)[0]
    storage = cv2.FileStorage(str(folder / "stereo.yml"), cv2.FILE_STORAGE_WRITE)
    values = {"M1": rig.left.K, "D1": rig.left.distortion, "M2": rig.right.K}
    values |= {"D2": rig.right.distortion, "R": rig.T_right_left.matrix[:3, :3]}
    values |= {"T": rig.T_right_left.translation_m, "R1": plan.R_left, "R2": plan.R_right}
    values |= {"P1": plan.rig.P_left, "P2": plan.rig.P_right}
    for name, value in values.items():
        storage.write(name, value)
    storage.release()
    plain = opened_with_rig(Folders(str(folder)), None)
    np.testing.assert_array_equal(plain.load(0).left, pinhole.left)
    assert any("--rectify.pictures raw" in note for note in plain.summary.notes)
    raw = opened_with_rig(Folders(str(folder)), None, rectify=Rectify(pictures="raw"))
    got, want = raw.load(0), rectified(pinhole, Rectify())
    np.testing.assert_array_equal(got.left, want.left)
    assert not any("taken for rectified" in note for note in raw.summary.notes)


def test_rectified_rigs_are_left_alone(pinhole: RawPair, tmp_path: Path) -> None:
    K = np.array([[320.0, 0, 240], [0, 320, 180], [0, 0, 1]])
    flat = replace(
        Rectify().plans(pinhole.rig)[0].rig,
        left=Camera(K, 480, 360),
        right=Camera(K, 480, 360, frame="camera_right"),
    )
    pair = RawPair(pinhole.left, pinhole.right, flat, "000000", 0, 1_000_000_000)
    source = opened_with_rig(Folders(str(stored(pair, tmp_path))), None)
    assert raw_rig(source) is None
    np.testing.assert_array_equal(source.load(0).left, pinhole.left)


def test_corrections_of_a_rig_belong_to_the_usual_pictures(
    pinhole: RawPair, tmp_path: Path
) -> None:
    rows = RowCorrection(np.array([2.0, *[0.0] * 8]), 0.1)
    refined = replace(pinhole, rig=replace(pinhole.rig, rows=rows))
    folder = Folders(str(stored(refined, tmp_path)))
    usual = opened_with_rig(folder, None)
    plain, moved = rectified(pinhole, Rectify()), usual.load(0)
    np.testing.assert_array_equal(moved.left, plain.left)
    np.testing.assert_array_equal(moved.right[:-3], plain.right[2:-1])  # 2 px lower than said
    other = opened_with_rig(folder, None, rectify=Rectify(alpha=0.5))
    assert "corrections of the rig left out" in other.summary.notes[-1]
    want = rectified(pinhole, Rectify(alpha=0.5))
    np.testing.assert_array_equal(other.load(0).right, want.right)


@pytest.fixture(scope="module")
def noise() -> RawPair:
    """What a narrow fisheye takes of nothing: cheap, and as good where pixels do not count."""
    rng = np.random.default_rng(3)
    left, right = (rng.integers(0, 255, (360, 480), np.uint8) for _ in range(2))
    rig = world_rig("fisheye", focal_px=400.0)
    return RawPair(left, right, rig, "000000", 0, 1_000_000_000)


def test_views_are_advised_where_the_lens_sees_more_alone(noise: RawPair, tmp_path: Path) -> None:
    source = opened_with_rig(Folders(str(stored(noise, tmp_path))), None)
    (note,) = [note for note in source.summary.notes if note.startswith("rectified")]
    assert "--rectify.views" not in note


def test_the_only_view_has_a_size_of_its_own(noise: RawPair, tmp_path: Path) -> None:
    rectify = Rectify(views=2, size=ImageSize(200, 150))
    source = opened_with_rig(Folders(str(stored(noise, tmp_path))), None, rectify=rectify)
    assert in_one_view(source).load(0).size_px == (480, 360)


def test_a_scan_whose_place_is_unknown_is_none_of_the_body(noise: RawPair) -> None:
    scan = LidarScan(np.array([[4.0, 1.0, -0.5]], np.float32), None, "velodyne", 5)
    body = rectified(replace(noise, scan=scan), Rectify(views=2))
    assert body.scan is None
    assert body.T_base_link_lidar is None


def test_a_rectified_rig_of_unknown_scale_leaves_what_is_in_metres_aside() -> None:
    source = pairs_of(Synthetic("room", frames=2, width_px=96, height_px=64).open())
    assert None not in (source.load(0).pose, source.load(0).scan)
    unknown = with_rig(source, replace(source.rig, metric=False))
    frame = unknown.load(0)
    assert (frame.pose, frame.motion, frame.scan, frame.labels) == (None, None, None, None)
    assert frame.rig.T_left_velodyne is None
    assert any("no metres" in note for note in unknown.summary.notes)
