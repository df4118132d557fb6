"""Detections to obstacles: how far, how big, how turned, each with its error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pseudolidar.geometry.box_in_view import nearest_depth_m
from pseudolidar.obstacles.class_sizes import ClassSize, size_of_class
from pseudolidar.obstacles.contour import Contour, contour_of, flat_contour, upright_part
from pseudolidar.obstacles.footprint import Edges, Footprint, fitted
from pseudolidar.obstacles.frustum import Frustum
from pseudolidar.obstacles.height import Span, upright_span
from pseudolidar.obstacles.level import level_axes, turned
from pseudolidar.obstacles.outline import outline_depth
from pseudolidar.obstacles.patch import patch_depth
from pseudolidar.obstacles.patch_matching import PatchDepth
from pseudolidar.obstacles.plausible import (
    BORDER_PX,
    EDGE_PX,
    Guess,
    by_footing,
    by_size,
    is_cut,
    runs_out_of_sight,
)
from pseudolidar.obstacles.separate import Owned, separated
from pseudolidar.obstacles.sight import Sight
from pseudolidar.obstacles.texture import row_texture
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Box3D, Detection
from pseudolidar.structures.camera import LEFT_FRAME
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose

# What counts as the face of a thing (bumpers, mirrors, arms) is unsure by so many times how round
# it is, and of flat things by this, m.
FACE_ROUNDS, FACE_M = 1.5, 0.003
# Something nearer fills this share of the box of what is occluded.
OCCLUDED_SHARE = 0.1
# How often what is left of such a thing is not the thing itself.
MISTAKEN = 0.1
# Pixels well inside of the box are used alone where there are so many.
LEAST_INNER = 30
# How well the edges of boxes lie that somebody drew around a flat thing, px.
DRAWN_PX = 1.0
# Share of a box that has points where everything is seen well; confidence of mere sizes.
WELL_FILLED, BY_SIZE_CONFIDENCE = 0.3, 0.1


def measured(sight: Sight, detections: Sequence[Detection]) -> tuple[Obstacle, ...]:
    """An obstacle for each detection, in their order: none is without a distance.

    The pixels of each are separated from ground, background, and from one another; an oriented
    rectangle with the usual size of its class is fitted to their near side as seen from above.
    Where an object has no pixels of its own, its distance is that of its size and footing.
    """
    R = level_axes(sight)
    return tuple(
        _obstacle(sight, detection, owned, R)
        for detection, owned in zip(detections, separated(sight, detections), strict=True)
    )


def _obstacle(sight: Sight, detection: Detection, owned: Owned, R: Float64) -> Obstacle:
    truncated = is_cut(sight, detection) or runs_out_of_sight(sight, detection)
    occluded = owned.hidden > OCCLUDED_SHARE
    size = size_of_class(detection.name)
    contour = _contour(sight, _surest(owned.pixels), R, size) if len(owned.pixels) else None
    patch = None
    if not size.round_m and (contour is None or contour.is_flat):
        patch = outline_depth(sight, detection) or patch_depth(sight, detection)
    if patch is not None:
        contour = _facing(sight, detection, patch, R)
    if contour is None:
        guess = _by_size(sight, detection, R)
        return replace(guess, truncated=truncated, occluded=occluded)
    footprint = fitted(contour, _edges(sight, detection, R), size, contour.near_m)
    span = upright_span(sight, detection, owned.pixels, footprint.nearest_m)
    doubt_m = _doubt_m(owned) if occluded else 0.0
    shared_m = _shared_m(sight, footprint.nearest_m)
    box = _box(footprint, span, R, float(np.hypot(shared_m, doubt_m)))
    distance_m, sigma_m = _distance(sight, box, footprint, size, patch)
    return Obstacle(
        detection=detection,
        distance_m=distance_m,
        sigma_distance_m=float(np.hypot(sigma_m, doubt_m)),
        box=box,
        sigma_heading_rad=_sigma_heading(footprint),
        measured_by="points" if patch is None else "patch",
        confidence=_confidence(detection, owned, patch) * _texture(sight, detection, size),
        truncated=truncated,
        occluded=occluded,
        sigma_shared_m=_shared_m(sight, distance_m),
        bound=patch is None and sight.may_be_nearer(owned.pixels.depth_m),
        pixels=owned.pixels.pixels,
    )


def _confidence(detection: Detection, owned: Owned, patch: PatchDepth | None) -> float:
    """0-1: score, how much of the box has points, how well size and footing fit."""
    if patch is not None:
        return float(np.clip(detection.score * patch.correlation, 0.0, 1.0))
    filled = min(1.0, float(owned.pixels.weight.sum()) / (WELL_FILLED * owned.pixels.area))
    confidence = detection.score * filled * float(np.exp(0.5 * owned.log_plausible))
    return float(np.clip(confidence, 0.0, 1.0))


def _texture(sight: Sight, detection: Detection, size: ClassSize) -> float:
    """What may be flat and plain, as drawn boxes, is no surer than what there is to be matched."""
    if size.round_m or detection.mask is not None:
        return 1.0
    return row_texture(sight, detection)


def _surest(pixels: Frustum) -> Frustum:
    inner = pixels.weight >= 1.0
    return pixels[inner] if np.count_nonzero(inner) >= LEAST_INNER else pixels


def _contour(sight: Sight, pixels: Frustum, R: Float64, size: ClassSize) -> Contour:
    """Of its upright part, in level axes."""
    upright = upright_part(pixels)
    xyz = turned(R, sight.xyz_at(upright.pixels))
    level = replace(
        upright,
        depth_m=xyz[:, 2],
        sigma_m=_own_sigma(sight, upright) * xyz[:, 2] / upright.depth_m,
    )
    return contour_of(level, xyz[:, 0] / xyz[:, 2], size.round_m)


def _facing(sight: Sight, detection: Detection, patch: PatchDepth, R: Float64) -> Contour:
    """Of a patch, in level axes."""
    left, top, right, bottom = detection.box_px
    z = float((R @ _ray(sight, 0.5 * (left + right), 0.5 * (top + bottom)))[2])
    first, last = (_bearing(sight, detection, u, R) for u in (left, right))
    return flat_contour(first, last, patch.depth_m * z, patch.sigma_m * z)


def _own_sigma(sight: Sight, pixels: Frustum) -> Float64:
    """(N,) sigma without what all pixels share, m; never less than a tenth."""
    shared = sight.shared_per_depth_squared * pixels.depth_m**2
    own = pixels.sigma_m**2 - shared**2
    return np.asarray(np.sqrt(np.maximum(own, 0.01 * pixels.sigma_m**2)))


def _edges(sight: Sight, detection: Detection, R: Float64) -> Edges:
    """Bearings of the left and right edge of the box."""
    left, _, right, _ = detection.box_px
    edge_px = EDGE_PX if size_of_class(detection.name).round_m else DRAWN_PX
    return Edges(
        None if left <= BORDER_PX else _bearing(sight, detection, left, R),
        None
        if right >= sight.camera.width_px - 1 - BORDER_PX
        else _bearing(sight, detection, right, R),
        edge_px / sight.camera.focal_px,
    )


def _bearing(sight: Sight, detection: Detection, u: float, R: Float64) -> float:
    """X / z in level axes of a column, at half the height of the box."""
    x, _, z = R @ _ray(sight, u, 0.5 * (detection.box_px[1] + detection.box_px[3]))
    return float(x / max(z, 1e-3))


def _ray(sight: Sight, u: float, v: float) -> Float64:
    """(3,) of a pixel, z = 1."""
    K = sight.camera.K
    return np.array([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], 1.0])


def _box(footprint: Footprint, span: Span, R: Float64, shared_m: float) -> Box3D:
    """The rectangle between the span's heights, in `camera_left`."""
    x, z, heading, length, width = footprint.values
    forward = np.array([np.sin(heading), 0.0, np.cos(heading)])
    up = np.array([0.0, -1.0, 0.0])
    axes = np.stack([forward, np.cross(up, forward), up], axis=1)
    centre = np.array([x, -0.5 * (span.low_m + span.high_m), z])
    pose = Pose.from_rotation(LEFT_FRAME, "box", R.T @ axes, R.T @ centre)
    return Box3D(
        pose, float(length), float(width), span.height_m, _box_sigma(footprint, span, shared_m)
    )


def _box_sigma(footprint: Footprint, span: Span, shared_m: float) -> Float64:
    """(6,) of the centre along the box's axes and of length, width, height, m."""
    x, z, heading = footprint.values[:3]
    ray = np.array([x, z]) / np.hypot(x, z)
    covariance = footprint.covariance[:2, :2] + shared_m**2 * np.outer(ray, ray)
    along = np.array([np.sin(heading), np.cos(heading)])
    across = np.array([np.cos(heading), -np.sin(heading)])
    of_size = np.sqrt(np.diag(footprint.covariance)[3:])
    centre = [np.sqrt(a @ covariance @ a) for a in (along, across)]
    return np.array([*centre, span.sigma_middle_m, *of_size, span.sigma_height_m])


def _distance(
    sight: Sight, box: Box3D, footprint: Footprint, size: ClassSize, patch: PatchDepth | None
) -> tuple[float, float]:
    """Of the nearest corner in view; of a patch that of itself, as it is flat."""
    if patch is not None:
        distance_m, fit_m = patch.depth_m, patch.sigma_m
    else:
        distance_m = nearest_depth_m(box, sight.camera) or footprint.nearest_m
        fit_m = footprint.sigma_nearest_m
    face_m = max(FACE_M, FACE_ROUNDS * size.round_m)
    shared_m = _shared_m(sight, distance_m)
    return distance_m, float(np.sqrt(fit_m**2 + shared_m**2 + face_m**2))


def _shared_m(sight: Sight, depth_m: float) -> float:
    return sight.shared_per_depth_squared * depth_m**2


def _sigma_heading(footprint: Footprint) -> float:
    """As the fit says, and at most that of any heading."""
    return float(min(np.sqrt(footprint.covariance[2, 2]), np.pi / np.sqrt(12)))


def _doubt_m(owned: Owned) -> float:
    """Error of a thing that something nearer hides: what is left of it may be what is behind.

    Then it stands somewhere between the two: the less plausible its own place is, the surer.
    """
    mistaken = MISTAKEN / (MISTAKEN + float(np.exp(owned.log_plausible)))
    return float(np.sqrt(mistaken) * owned.before_m)


def _guessed(sight: Sight, detection: Detection) -> Guess:
    """Where its size and its footing put it."""
    guesses = [by_size(sight, detection)]
    footing = by_footing(sight, detection)
    if size_of_class(detection.name).stands and footing is not None:
        guesses.append(footing)
    weights = np.array([guess.sigma_m**-2 for guess in guesses])
    depth_m = float(weights @ [guess.depth_m for guess in guesses] / weights.sum())
    return Guess(depth_m, float(weights.sum() ** -0.5))


def _by_size(sight: Sight, detection: Detection, R: Float64) -> Obstacle:
    """Where its size and its footing put it: for what has no points of its own."""
    size, guess = size_of_class(detection.name), _guessed(sight, detection)
    distance_m, sigma_m = guess.depth_m, guess.sigma_m
    left, top, right, bottom = detection.box_px
    middle = _ray(sight, 0.5 * (left + right), 0.5 * (top + bottom))
    centre = middle * (distance_m + 0.5 * size.length_m[0])
    axes = R.T @ np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    sigma = np.array(
        [sigma_m, *[sigma_m * EDGE_PX / sight.camera.focal_px + FACE_M] * 2, *size.sigma_m]
    )
    pose = Pose.from_rotation(LEFT_FRAME, "box", axes, centre)
    length_m, width_m, height_m = (float(m) for m in size.mean_m)
    return Obstacle(
        detection,
        distance_m,
        sigma_m,
        Box3D(pose, length_m, width_m, height_m, sigma),
        sigma_heading_rad=float(np.pi / np.sqrt(12)),
        measured_by="size",
        confidence=BY_SIZE_CONFIDENCE * detection.score,
    )
