"""Places and contacts: errors lie along the ray, and are those of drawn cases."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.obstacles.contact import contact_of
from pseudolidar.obstacles.placing import all_placed, placed, relative_pose
from pseudolidar.structures.box import Box3D, Detection
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose


def turned_box(heading: float, x: float, z: float, sigma: list[float]) -> Box3D:
    c, s = math.cos(heading), math.sin(heading)
    R = R_BODY_OPTICAL.T @ np.array([[c, -s, 0.0], [s, c, 0.0], [0, 0, 1.0]])
    pose = Pose.from_rotation("camera_left", "box", R, np.array([x, 0.0, z]))
    return Box3D(pose, 4.0, 1.7, 1.5, np.array([*sigma, 0.3, 0.1, 0.1]))


@pytest.mark.parametrize("heading_deg", [0, 20, 45, 70, 90, 135, 180])
def test_the_error_along_the_ray_is_found_whatever_way_a_box_is_turned(heading_deg: float) -> None:
    along, across = 1.5, 0.1
    heading = math.radians(heading_deg)
    # relative to a ray straight ahead
    c2, s2 = math.cos(heading) ** 2, math.sin(heading) ** 2
    length = math.sqrt(along**2 * c2 + across**2 * s2)
    width = math.sqrt(along**2 * s2 + across**2 * c2)
    box = turned_box(heading, 0.0, 30.0, [length, width, 0.1])
    one = Obstacle(Detection("Car", (0.0, 0.0, 1.0, 1.0)), 28.0, along, box, 0.1)
    place = placed(one, relative_pose(), (0.5, 0.0), edges_seen=True)
    np.testing.assert_allclose(place.xyz, [30.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(place.axes @ place.axes.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(place.axes[0], [1.0, 0.0, 0.0], atol=1e-12)
    assert place.sigma_m[0] == pytest.approx(along, rel=0.02)
    hidden = placed(one, relative_pose(), (0.5, 0.0), edges_seen=False)
    assert hidden.sigma_m[0] == pytest.approx(along, rel=0.02)
    assert place.sigma_m[1] < 0.3  # and not the 1.06 m that a diagonal of a turned box would say
    total = length**2 + width**2
    assert place.sigma_m[0] ** 2 + place.sigma_m[1] ** 2 == pytest.approx(total)


def test_a_ray_to_the_side_is_turned_with_the_camera() -> None:
    box = turned_box(0.0, 10.0, 10.0, [0.5, 0.5, 0.1])
    one = Obstacle(Detection("Car", (0.0, 0.0, 1.0, 1.0)), 8.0, 0.5, box, 0.1)
    at = Pose.from_rotation("map", "camera_left", R_BODY_OPTICAL, np.array([5.0, 0.0, 2.0]))
    place = placed(one, at, (0.0, 0.0), edges_seen=True)
    np.testing.assert_allclose(place.xyz, [15.0, -10.0, 2.0], atol=1e-12)
    np.testing.assert_allclose(place.axes[0], [math.sqrt(0.5), -math.sqrt(0.5), 0.0], atol=1e-12)


def test_what_may_be_hidden_in_part_is_less_sure_across() -> None:
    def seen(z: float, left: float, right: float) -> Obstacle:
        box = turned_box(0.0, 0.0, z, [0.3, 0.1, 0.1])
        return Obstacle(Detection("Car", (left, 0.0, right, 50.0)), z - 2.0, 0.3, box, 0.1)

    alone = all_placed([seen(30.0, 100, 140)], relative_pose(), (0.5, 0.0))[0].sigma_m[1]
    far, near = all_placed(
        [seen(30.0, 100, 140), seen(15.0, 142, 200)], relative_pose(), (0.5, 0.0)
    )
    assert alone < 0.15
    assert far.sigma_m[1] > 0.39  # a tenth of its 4 m may be behind the nearer one
    assert near.sigma_m[1] < 0.15
    far, _ = all_placed([seen(30.0, 100, 140), seen(15.0, 160, 200)], relative_pose(), (0.5, 0.0))
    assert far.sigma_m[1] == pytest.approx(alone)


def test_the_sigma_of_a_contact_is_that_of_drawn_ones() -> None:
    covariance = np.zeros((6, 6))
    covariance[2, 2], covariance[5, 5], covariance[2, 5] = 0.3**2, 0.4**2, 0.06
    covariance[5, 2], covariance[0, 0], covariance[3, 3] = 0.06, 0.05**2, 0.1**2
    box = turned_box(0.0, 1.0, 20.0, [0.3, 0.1, 0.1])
    relative = np.array([-0.5, 0.0, -6.0])
    contact = contact_of(box, relative, covariance)
    assert contact is not None
    assert contact.time_s == pytest.approx(18.0 / 6.0)
    assert contact.left_m == pytest.approx(1.0 - 0.85 - 1.5)
    assert contact.right_m == pytest.approx(1.0 + 0.85 - 1.5)
    off = np.random.default_rng(0).multivariate_normal(np.zeros(6), covariance, 20_000)
    times = (18.0 + off[:, 2]) / (6.0 - off[:, 5])
    across = 1.0 + off[:, 0] + times * (-0.5 + off[:, 3])
    assert contact.sigma_time_s == pytest.approx(np.std(times), rel=0.06)
    assert contact.sigma_across_m == pytest.approx(np.std(across), rel=0.06)


def test_no_contact_where_it_does_not_surely_come_nearer() -> None:
    box = turned_box(0.0, 1.0, 20.0, [0.3, 0.1, 0.1])
    covariance = np.diag([0.1, 0.1, 0.1, 0.25, 0.25, 0.25])
    assert contact_of(box, np.array([0.0, 0.0, -0.9]), covariance) is None
    assert contact_of(box, np.array([0.0, 0.0, 3.0]), covariance) is None
    assert contact_of(box, np.array([0.0, 0.0, -1.1]), covariance) is not None
    behind = turned_box(0.0, 1.0, 1.0, [0.3, 0.1, 0.1])
    assert contact_of(behind, np.array([0.0, 0.0, -5.0]), covariance) is None


def test_what_the_rig_leaves_is_apart_from_a_thing_s_own_error() -> None:
    box = turned_box(0.0, 0.0, 30.0, [1.3, 0.1, 0.1])
    one = Obstacle(Detection("Car", (0, 0, 1, 1)), 28.0, 1.3, box, 0.1, sigma_shared_m=1.2)
    place = placed(one, relative_pose(), (0.5, 0.0), edges_seen=True)
    assert place.shared_m == 1.2
    assert place.sigma_m[0] == pytest.approx(0.5, abs=0.03)  # 1.3^2 - 1.2^2
