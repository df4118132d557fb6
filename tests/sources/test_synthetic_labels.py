import numpy as np
import pytest

from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.sources.synthetic import Synthetic, SyntheticSource
from pseudolidar.structures.box import Label
from pseudolidar.structures.frame import StereoFrame


@pytest.fixture(scope="module")
def source() -> SyntheticSource:
    return Synthetic("street", frames=200, width_px=480).open()


@pytest.fixture(scope="module")
def frame(source: SyntheticSource) -> StereoFrame:
    return source.load(0)


def test_street_has_cars_and_persons_near_and_far(frame: StereoFrame) -> None:
    names = [label.detection.name for label in frame.labels]
    assert {"Car", "Pedestrian"} == set(names)
    assert len(names) >= 8
    depths = [label.box.pose.translation_m[2] for label in frame.labels]
    assert depths == sorted(depths)
    assert depths[0] < 15
    assert depths[-1] > 40
    numbers = [label.track_id for label in frame.labels]
    assert len(set(numbers)) == len(numbers)


def test_boxes_hold_the_points_of_their_pixels(source, frame) -> None:
    depth = source.truth_pair(0).depth_left.values.astype(np.float64)
    for label in frame.labels:
        own = in_box(source, depth, label)
        half = 0.5 * np.array([label.box.length_m, label.box.width_m, label.box.height_m])
        assert (np.abs(own) < half + 0.02).all()


def test_boxes_fit_tightly(source, frame) -> None:
    """The nearest label's visible points reach the faces of its box."""
    label = next(x for x in frame.labels if x.truncation == 0 and x.occlusion == 0)
    depth = source.truth_pair(0).depth_left.values.astype(np.float64)
    own = in_box(source, depth, label)
    half = 0.5 * np.array([label.box.length_m, label.box.width_m, label.box.height_m])
    assert (np.abs(own).max(axis=0) > half - 0.1).all()


def in_box(source: SyntheticSource, depth: np.ndarray, label: Label) -> np.ndarray:
    """(N, 3) points of the label's visible pixels in its box's axes."""
    v, u = np.nonzero(label.detection.mask)
    rays = np.stack([u, v, np.ones(len(u))], axis=1) @ np.linalg.inv(source.rig.left.K).T
    return label.box.pose.inverse().apply(rays * depth[v, u][:, None])


def test_2d_boxes_hold_the_mask_exactly(frame: StereoFrame) -> None:
    for label in frame.labels:
        v, u = np.nonzero(label.detection.mask)
        assert label.detection.box_px == (u.min(), v.min(), u.max(), v.max())


def test_truncation_and_occlusion_say_what_is_missing(frame: StereoFrame) -> None:
    width = frame.left.shape[1]
    for label in frame.labels:
        left, _, right, _ = label.detection.box_px
        if label.truncation > 0.05:
            assert left <= 1 or right >= width - 2
        assert label.occlusion in (0, 1, 2)
    assert any(label.truncation > 0.1 for label in frame.labels)
    assert {0, 1, 2} == {label.occlusion for label in frame.labels}


def test_moving_things_keep_their_number_and_parked_ones_their_place(source) -> None:
    first, second = source.load(0), source.load(5)
    T_map_left = [source.pose(i) @ left_in_base_link(source.rig) for i in (0, 5)]
    before = {x.track_id: T_map_left[0].matrix @ x.box.pose.matrix for x in first.labels}
    after = {x.track_id: T_map_left[1].matrix @ x.box.pose.matrix for x in second.labels}
    both = before.keys() & after.keys()
    assert len(both) >= 6
    moved = {k: np.linalg.norm(after[k][:3, 3] - before[k][:3, 3]) for k in both}
    parked = [k for k in both if k >= 1_000_000]
    assert parked
    assert max(moved[k] for k in parked) < 1e-6
    walking = [moved[k] for k in both if 100_000 <= k < 500_000]
    np.testing.assert_allclose(walking, 0.65, atol=0.05)  # half a second of walking
    assert moved[1] == pytest.approx(4.0, abs=1.2)  # the car ahead


def test_a_car_crosses_at_a_side_street() -> None:
    """Somewhere on the first 100 m a car goes across the view."""
    source = Synthetic("street", frames=200, width_px=320).open()
    across = []
    for index in range(40, 70, 5):
        for label in source.load(index).labels:
            if label.track_id >= 500_000 and label.track_id < 900_000:
                forward = label.box.pose.matrix[:3, 0]
                across.append(abs(forward[0]))
    assert across
    assert min(across) > 0.7
