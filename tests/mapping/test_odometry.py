"""Fused odometry on a rendered street: patches, the map, and steps of vision made wrong."""

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import ScanMissing
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.twists import exp_twist, inverted, log_twist
from pseudolidar.mapping.alignment import Prior, align
from pseudolidar.mapping.disparity_offset import Offset
from pseudolidar.mapping.fused_chain import FusedChain
from pseudolidar.mapping.fused_path import FusedPath, FusedStep
from pseudolidar.mapping.odometry import Fused, Kiss, Vision
from pseudolidar.mapping.patches import find_patches
from pseudolidar.mapping.scan_counts import ScanCounts
from pseudolidar.mapping.surface_map import Surfaces
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import LidarScan
from pseudolidar.structures.odometry import CameraStep, OdometryState
from pseudolidar.structures.pose import Pose, rotation_error

FRAMES = 4
DOUBT = np.diag([1e-5] * 3 + [1e-8] * 3)
FAULTS = {
    "halved": lambda T: np.block([[T[:3, :3], 0.5 * T[:3, 3:]], [T[3:]]]),
    "x1.3": lambda T: np.block([[T[:3, :3], 1.3 * T[:3, 3:]], [T[3:]]]),
    "yaw": lambda T: T @ exp_twist(np.radians([0.0, 0.0, 0.0, 0.0, 1.5, 0.0])),
}


@pytest.fixture(scope="module")
def street():
    """Frames of a street with exact disparities, and true poses in the first camera."""
    source = Synthetic("street", frames=FRAMES, width_px=620).open()
    frames = [source.load(i) for i in range(FRAMES)]
    T_base_left = left_in_base_link(source.rig).matrix
    T = [frame.pose.matrix @ T_base_left for frame in frames]
    return frames, [inverted(T[0]) @ one for one in T]


class Told:
    """Tells true steps, the last one made wrong."""

    correction, offset = None, Offset()

    def __init__(self, truth, fault, *, always=False, by_offset=None):
        self.truth, self.fault, self.number = truth, fault, -1
        self.always = always
        self.by_offset = np.zeros(6) if by_offset is None else by_offset

    def register(self, frame, *_):
        self.number += 1
        if self.number == 0:
            pose = Pose.identity("odom", frame.rig.left.frame)
            return OdometryState("first", pose, covariance=np.zeros((6, 6)))
        T = inverted(self.truth[self.number - 1]) @ self.truth[self.number]
        T = self.fault(T) if self.always or self.number == FRAMES - 1 else T
        pose = Pose("odom", frame.rig.left.frame, self.truth[self.number])
        return OdometryState(
            "ok", pose, step=CameraStep(T, DOUBT, by_offset=self.by_offset), covariance=DOUBT
        )


def drive(frames, truth, fault):
    chain = FusedChain(Told(truth, fault), frames[0].rig, reach=5)
    return [chain.register(frame, frame.truth) for frame in frames]


@pytest.mark.parametrize("kind", FAULTS)
def test_a_wrong_step_is_found_out_and_replaced(street, kind):
    frames, truth = street
    told = drive(frames, truth, FAULTS[kind])
    assert [bool(one.check and one.check.wrong) for one in told] == [False, False, False, True]
    assert told[-1].check.asked == "pictures"
    off = log_twist(inverted(truth[-1]) @ told[-1].state.T_odom_camera.matrix)
    assert np.linalg.norm(off[:3]) < 0.05
    assert np.linalg.norm(off[3:]) < 0.004


def test_true_steps_stay_as_they_are(street):
    frames, truth = street
    told = drive(frames, truth, lambda T: T)
    assert not any(one.check and one.check.wrong for one in told)
    off = log_twist(inverted(truth[-1]) @ told[-1].state.T_odom_camera.matrix)
    assert np.linalg.norm(off[:3]) < 0.01
    assert told[-1].alignment.matched > 0.2
    assert told[-1].state.covariance[0, 0] > told[-2].state.covariance[0, 0]


def test_vision_and_fused_tell_the_same_of_a_street(street):
    frames, truth = street
    vision, fused = (kind().start(frames[0].rig) for kind in (Vision, Fused))
    for frame in frames:
        ends = [chain.register(frame, frame.truth).state for chain in (vision, fused)]
    way_m = np.linalg.norm(truth[-1][:3, 3])
    paths = [path for chain in (vision, fused) for path in chain.trajectories()]
    assert [len(path) for path in paths] == [FRAMES, FRAMES]
    poses = [end.T_odom_camera.matrix for end in ends] + [path.T_world_body[-1] for path in paths]
    for T in poses:
        assert np.linalg.norm(T[:3, 3] - truth[-1][:3, 3]) < 0.005 * way_m
    for path in paths:
        assert not path.covariance[0].any()
        assert np.linalg.eigvalsh(path.covariance[-1])[0] > 0


def test_scans_put_right_what_an_unknown_offset_does_to_steps(street):
    frames, truth = street
    way_m, errors_m = np.linalg.norm(truth[-1][:3, 3]), {}
    for seen in ("scans", "patches", "too few points"):
        # lengths are off by 3 %, and an offset that is unsure by 1 px would make 5 % of them
        unsure = np.array([0.0, 0.0, 0.05 * way_m / (FRAMES - 1), 0.0, 0.0, 0.0])
        longer = Told(truth, stretched, always=True, by_offset=unsure)
        chain, told = FusedChain(longer, frames[0].rig, reach=5), []
        for frame in frames:
            scan = {
                "scans": frame.scan,
                "patches": None,
                "too few points": LidarScan(frame.scan.xyz[:50].copy()),
            }[seen]
            told.append(chain.register(replace(frame, scan=scan), frame.truth))
        assert [one.by_scan for one in told[1:]] == [seen == "scans"] * (FRAMES - 1)
        T = told[-1].state.T_odom_camera.matrix
        errors_m[seen] = np.linalg.norm(T[:3, 3] - truth[-1][:3, 3])
    assert errors_m["scans"] < 0.005 * way_m
    assert errors_m["patches"] > 0.02 * way_m
    assert errors_m["too few points"] == errors_m["patches"]


def test_scans_that_say_nothing_are_counted_and_vision_goes_on(street):
    frames, truth = street
    few, nothing = frames[1].scan.xyz[:50].copy(), np.full((30, 3), np.nan, np.float32)
    in_the_sky = frames[3].scan.xyz + np.array([0, 0, 30], np.float32)
    odd = zip(frames[1:], (few, nothing, in_the_sky), strict=True)
    seen = [replace(frame, scan=LidarScan(xyz)) for frame, xyz in odd]
    chain = FusedChain(Told(truth, lambda T: T), frames[0].rig, reach=5)
    told = [chain.register(frame, frame.truth) for frame in (frames[0], *seen)]
    assert [one.sensors for one in told] == ["vision"] * 4
    assert chain.scan_counts == ScanCounts(4, empty=1, few=1, unplaced=1, dropped_points=30)


def stretched(T):
    return np.block([[T[:3, :3], 1.03 * T[:3, 3:]], [T[3:]]])


def test_kiss_alone_wants_scans_and_follows_the_camera_by_them(street):
    frames, truth = street
    chain = Kiss().start(frames[0].rig)
    states = [chain.register(frame, frame.truth).state for frame in frames[:3]]
    assert states[-1].T_odom_camera.src == frames[0].rig.left.frame
    # Two steps, the first one found from a guess of rest in a map of one scan.
    assert np.linalg.norm(states[-1].T_odom_camera.matrix[:3, 3] - truth[2][:3, 3]) < 0.2
    (path,) = chain.trajectories()
    assert np.array_equal(path.T_world_body[-1], states[-1].T_odom_camera.matrix)
    assert np.array_equal(path.covariance[-1], states[-1].covariance)
    with pytest.raises(ScanMissing, match="--odometry fused"):
        chain.register(replace(frames[3], scan=None), frames[3].truth)


def test_patches_of_a_slanted_plane_lie_on_it(street):
    rig = street[0][0].rig
    width, height = rig.left.size_px
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    values = (12.0 + 0.01 * (u - width / 2) + 0.02 * (v - height / 2)).astype(np.float32)
    values[:, :40] = np.nan
    patches = find_patches(DisparityMap(values), rig)
    assert len(patches) > 500
    normal = np.median(patches.normals, axis=0)
    assert np.allclose(patches.normals, normal, atol=1e-4)
    along = patches.xyz @ normal
    assert np.ptp(along) < 1e-3
    assert along[0] < 0  # to the sensor's side


def test_a_map_without_surfaces_leaves_the_prior(street):
    patches = find_patches(street[0][0].truth, street[0][0].rig)
    T = exp_twist(np.array([0.3, 0.0, 1.0, 0.0, 0.1, 0.0]))
    found = align(patches, Surfaces(np.zeros((0, 3))), Prior(T, np.eye(6)), within_m=0.5)
    assert np.allclose(found.T_odom_sensor, T)
    assert (found.matched, found.score) == (0.0, 0.0)


def test_a_long_path_stays_rigid():
    # Steps bent by rounding: taken for rigid, their errors would double with each of them.
    step = exp_twist(np.array([0.9, 0.01, 0.02, 0.001, 0.01, -0.002]))
    bent = step + 1e-14 * np.random.default_rng(0).normal(size=(4, 4)) * (np.arange(4) < 3)[:, None]
    path = FusedPath(0)
    for number in range(1, 200):
        T_from_to = inverted(path.last.T_odom_camera) @ (path.last.T_odom_camera @ bent)
        path.add(number, FusedStep(T_from_to, 1e-6 * np.eye(6), np.zeros(6)))
    assert rotation_error(path.last.T_odom_camera[:3, :3]) < 1e-12
