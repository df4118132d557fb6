"""Trials of the parts of an installation: each does a little real work and checks the result.

`python -m pseudolidar.running.installation.part_trials NAME` runs one, so that a library that
kills the process is found out from outside.
"""

from __future__ import annotations

import io
import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from pseudolidar.errors import PseudolidarError, StructureError
from pseudolidar.structures.arrays import UInt8
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.point_tracks import PointTracks
from pseudolidar.structures.pose import Pose

_HEIGHT, _WIDTH = 96, 192
_SHIFT_PX = 8
_SEED = 7
_FOCAL_PX, _BASELINE_M = 100.0, 0.5
_VOXEL_M = 0.05
_HEIGHT_M = 1.7
# An ONNX graph that adds two vectors of two numbers (opset 13), as `onnx.helper` writes it.
_SUM_GRAPH = bytes.fromhex(
    "080812003a460a0e0a01610a016212016322034164641201675a0f0a0161120a0a08080112040a02"
    "08025a0f0a0162120a0a08080112040a020802620f0a0163120a0a08080112040a02080242040a00"
    "100d"
)


def images() -> str:
    """Encode and decode pictures."""
    from pseudolidar.formats.pictures.image import decode_image, encode_jpeg, encode_png

    picture = np.ascontiguousarray(_texture()[:, :_WIDTH])
    _check(np.array_equal(decode_image(encode_png(picture), "trial.png").pixels, picture), "PNG")
    jpeg = decode_image(encode_jpeg(picture), "trial.jpg").pixels
    _check(jpeg.shape == picture.shape, "JPEG")
    return "PNG and JPEG written and read"


def matcher() -> str:
    """Compile or load the kernels, match a pair of known disparity in both qualities, reproject."""
    from pseudolidar.stereo.census import Census
    from pseudolidar.stereo.reproject import Reproject

    frame, reproject = trial_frame(), Reproject(voxel_m=_VOXEL_M).load()
    qualities: tuple[Literal["fast", "fine"], ...] = ("fast", "fine")
    for quality in qualities:
        found = Census(quality=quality, disparities=32).load()(frame)
        median = float(np.nanmedian(found.values))
        _check(abs(median - _SHIFT_PX) < 0.5, f"{quality}: {median} px, want {_SHIFT_PX}")
        depth_m = float(np.median(reproject(frame, found).xyz[:, 2]))
        want_m = _FOCAL_PX * _BASELINE_M / _SHIFT_PX
        _check(abs(depth_m / want_m - 1) < 0.05, f"{quality}: {depth_m} m, want {want_m}")
    return "kernels compiled, known disparity found"


def filters() -> str:
    """Compile or load the kernels of cleaning, optional filters and tools, and filter a wall."""
    from pseudolidar.clouds.beams import Beams
    from pseudolidar.clouds.normals import Normals
    from pseudolidar.clouds.outliers import Lonely
    from pseudolidar.clouds.tool import CloudTools
    from pseudolidar.evaluation.cloud_views import Eye, perspective
    from pseudolidar.evaluation.pictures import NOTHING
    from pseudolidar.geometry.frames import frame_tree
    from pseudolidar.geometry.normals import normals_of_neighbours
    from pseudolidar.geometry.rectified_pixels import unmasked
    from pseudolidar.geometry.warping import Warp
    from pseudolidar.mapping.patches import find_patches
    from pseudolidar.stereo.filters.clean import Clean
    from pseudolidar.stereo.filters.filled_map import Surfaces
    from pseudolidar.stereo.filters.map_filter import MapFilters
    from pseudolidar.stereo.filters.smoothed_map import Fgs
    from pseudolidar.stereo.filters.temporal import Kalman
    from pseudolidar.stereo.reproject import Reproject
    from pseudolidar.structures.frame import PairMask

    values = np.full((_HEIGHT, _WIDTH), _SHIFT_PX, np.float32)
    frame = trial_frame()
    wall = MapFilters.load(Fgs(), Surfaces())(frame, DisparityMap(values)).disparity
    _check(np.allclose(wall.values, _SHIFT_PX, atol=0.01), "a flat wall")
    still = _Still()
    fuse = Kalman(window=2).load(lambda _: wall, still)
    fused = fuse(still.load(1), wall).disparity
    _check(np.allclose(fused.values, _SHIFT_PX, atol=0.01), "a flat wall, seen twice")
    cleaned = Clean().load()(frame, DisparityMap(values, np.full_like(values, 0.1)))
    _check(not cleaned.reason[:, _SHIFT_PX:].any(), "a flat wall, cleaned")
    there = Warp.by(values, frame.rig, np.eye(4)).maps[0]
    _check(np.allclose(there, np.arange(_WIDTH), atol=0.01), "a flat wall, seen from where it was")
    patches = find_patches(DisparityMap(values), frame.rig)
    _check(bool(np.allclose(patches.normals[:, 2], -1)), "patches of a flat wall")
    _check(_still_pose(frame.rig) < 1e-3, "the motion of a camera that stands still")
    _check(_mapped_wall(frame.rig, wall), "a flat wall, seen three times, in a map")
    shown = np.ones((_HEIGHT, _WIDTH), bool)
    shown[:, _WIDTH // 2 :] = False
    half = unmasked(wall, PairMask(shown, np.ones_like(shown)))
    dropped = half.valid.any() and not half.valid[:, _WIDTH // 2 :].any()
    _check(bool(dropped), "half of a flat wall")
    cloud = Reproject().load()(trial_frame(), wall)
    tools = CloudTools.load(Lonely(), Normals(), Beams())
    beams, _ = tools(cloud, frame_tree(trial_frame().rig))
    _check(bool(np.nanmax(np.abs(beams.extra["nz"] + 1)) < 0.01), "normals of a flat wall")
    seen = perspective(cloud, Eye((0.0, 0.0, 0.0), (0.0, 0.01, 1.0)), point_m=0.05)
    _check(bool((seen != NOTHING).any()), "a picture of its points")
    in_space = normals_of_neighbours(cloud.xyz[:500], np.zeros(3))
    _check(np.allclose(in_space[:, 2], -1, atol=0.01), "normals of its points in space")
    return "kernels compiled, a flat wall stayed flat"


def obstacles() -> str:
    """Compile or load the kernels of the ground and of boxes, find a road, fit a box to a wall."""
    from pseudolidar.clouds.ground import Label
    from pseudolidar.obstacles.class_sizes import CAR
    from pseudolidar.obstacles.contour import flat_contour
    from pseudolidar.obstacles.footprint import Edges, fitted

    ahead, aside = np.mgrid[3:30:0.3, -8:8:0.3]
    road = np.stack([ahead, aside, np.full_like(ahead, -_HEIGHT_M)], axis=2).reshape(-1, 3)
    plane, _ = Label().load().found(PointCloud(road.astype(np.float32), "velodyne"), ())
    _check(plane is not None and abs(plane.offset_m - _HEIGHT_M) < 0.01, "the height of a road")
    wall = flat_contour(-0.05, 0.05, 15.0, 0.1)
    nearest_m = fitted(wall, Edges(-0.05, 0.05, 0.002), CAR, wall.near_m).nearest_m
    _check(abs(nearest_m - 15.0) < 0.2, f"a wall at 15 m: {nearest_m} m")
    return "kernels compiled, a road and a wall where they are"


def clouds() -> str:
    """Write and read a point cloud, compressed too; put its points into an octree."""
    from pseudolidar.formats.points.pcd import read_pcd, write_pcd
    from pseudolidar.geometry.octree import octree_order

    cloud = PointCloud(np.random.default_rng(_SEED).random((500, 3), np.float32), "camera_left")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trial.pcd"
        write_pcd(path, cloud, encoding="binary_compressed")
        _check(np.array_equal(read_pcd(path).xyz, cloud.xyz), "PCD")
    for dtype in (np.float32, np.float64):
        order = octree_order(cloud.xyz.astype(dtype)).order
        _check(np.array_equal(np.sort(order), np.arange(len(cloud))), "points of an octree")
    return "PCD written and read, an octree built"


def recordings() -> str:
    """Write an MCAP and read it with the library's own reader."""
    from mcap.reader import make_reader

    from pseudolidar.formats.mcap.frame import pack_frame
    from pseudolidar.formats.mcap.log import McapLog
    from pseudolidar.formats.mcap.messages import frame_messages
    from pseudolidar.formats.mcap.prolog import McapProlog

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trial.mcap"
        with McapLog(path, McapProlog({"version": "trial"})) as log:
            log.append(pack_frame(frame_messages(trial_frame()), index=0))
        with path.open("rb") as file:
            count = sum(1 for _ in make_reader(file).iter_messages())
    _check(count > 0, "no message came back")
    return f"MCAP written and read, {count} messages"


def networks() -> str:
    """Run a graph of one node, and tell where networks can run."""
    import onnxruntime

    from pseudolidar.formats.onnx.session import available_providers

    runs = onnxruntime.InferenceSession(_SUM_GRAPH, providers=["CPUExecutionProvider"])
    given = {"a": np.array([1, 2], np.float32), "b": np.array([3, 4], np.float32)}
    _check(runs.run(None, given)[0].tolist() == [4, 6], "a sum")
    places = ", ".join(available_providers())
    return f"a graph run; onnxruntime {onnxruntime.__version__} can use {places}"


def reports() -> str:
    """Draw a figure and fill a template."""
    import jinja2
    from matplotlib.figure import Figure

    figure, drawn = Figure(), io.BytesIO()
    figure.subplots().plot([0, 1])
    figure.savefig(drawn, format="png")
    _check(drawn.tell() > 0, "no figure")
    _check(jinja2.Template("{{ 1 + 1 }}").render() == "2", "no template")
    return "figure drawn, template filled"


def worlds() -> str:
    """Load open3d, render a small picture with it, and mesh a wall."""
    from pseudolidar.geometry.open3d_library import load_open3d
    from pseudolidar.mapping.mesh import TsdfMesh
    from pseudolidar.mapping.occupancy import Occupancy
    from pseudolidar.sources.synthetic import Synthetic

    load_open3d()
    frame = Synthetic("street", frames=1, width_px=_WIDTH).open().load(0)
    _check(frame.truth is not None and bool(np.isfinite(frame.truth.values).any()), "no depth")
    wall = np.full((_HEIGHT, _WIDTH), 4.0, np.float32)
    grid = TsdfMesh().start(trial_frame().rig)
    grey = np.full((_HEIGHT, _WIDTH, 3), 100, np.uint8)
    grid.integrate(wall, 0.01 * wall, grey, Pose.identity("map", "camera_left"))
    middle_m = float(np.median(grid.extract().vertices[:, 2]))
    _check(abs(middle_m - 4.0) < 0.01, f"a wall at {middle_m} m, want 4")
    occupancy = Occupancy().start()
    occupancy.integrate(PointCloud(grid.extract().vertices, "map"), np.zeros(3))
    _check(len(occupancy.occupied()) > 0, "no voxel of a wall")
    return "open3d loaded, a street rendered, a wall meshed"


def processor() -> str:
    """What LLVM compiles the kernels for, and what that means for speed."""
    from llvmlite import binding

    features = {name for name, on in binding.get_host_cpu_features().items() if on}
    level, speed = next(
        (level, speed) for level, needed, speed in _SIMD_LEVELS if needed <= features
    )
    return f"{binding.get_host_cpu_name()}, {level}: {speed}"


# Matching time of one KITTI pair on one thread against OpenCV's three-way SGBM in the same run,
# by what the kernels were compiled for; measured on a machine with AVX-512, 2026-11.
_SIMD_LEVELS: tuple[tuple[str, frozenset[str], str], ...] = (
    ("AVX-512", frozenset({"avx512bw", "avx512vl"}), "matching at full speed"),
    ("AVX2", frozenset({"avx2"}), "matching takes about 1.6 times as long as with AVX-512"),
    ("SSE4.2", frozenset({"sse4.2"}), "matching takes about 2.5 times as long as with AVX-512"),
    ("NEON", frozenset({"neon"}), "vectorised; its speed was not measured"),
    ("no SIMD that we know", frozenset(), "matching may be slow"),
)


TRIALS: dict[str, Callable[[], str]] = {
    trial.__name__: trial
    for trial in (
        *(images, matcher, filters, obstacles, clouds, recordings),
        *(networks, reports, worlds, processor),
    )
}


def trial_frame() -> StereoFrame:
    """A small textured pair of one known disparity."""
    texture = _texture()
    left = np.ascontiguousarray(texture[:, :_WIDTH])
    right = np.ascontiguousarray(texture[:, _SHIFT_PX : _SHIFT_PX + _WIDTH])
    K = np.array([[_FOCAL_PX, 0, _WIDTH / 2], [0, _FOCAL_PX, _HEIGHT / 2], [0, 0, 1]])
    rig = StereoRig(
        Camera(K, _WIDTH, _HEIGHT, frame="camera_left"),
        Camera(K, _WIDTH, _HEIGHT, frame="camera_right"),
        Pose.from_rotation(
            "camera_right", "camera_left", np.eye(3), np.array([-_BASELINE_M, 0.0, 0.0])
        ),
    )
    return StereoFrame(left, right, rig, id="trial", index=0, timestamp_ns=10**9)


class _Still:
    """A camera that does not move."""

    def load(self, index: int) -> StereoFrame:
        return replace(trial_frame(), index=index, pose=Pose.identity("map", "base_link"))


def _still_pose(rig: StereoRig) -> float:
    """By how many metres points that stay where they are move the camera."""
    from pseudolidar.geometry.pnp import refined_pose

    uv = np.random.default_rng(_SEED).uniform((0, 0), (_WIDTH, _HEIGHT), (100, 2))
    d = np.linspace(2.0, 20.0, len(uv))
    found = refined_pose(np.eye(4), PointTracks(uv, d, uv, d), rig)
    return float("inf") if found is None else found.distance_m


def _mapped_wall(rig: StereoRig, wall: DisparityMap) -> bool:
    """Whether the points of a wall that a still camera sees lie on it, and none in front of it."""
    from pseudolidar.mapping.free_space import FreeSpace
    from pseudolidar.mapping.fusion import TemporalFusion
    from pseudolidar.mapping.map_points import MapPoints

    fusion = TemporalFusion().start()
    with tempfile.TemporaryDirectory() as folder:
        free = FreeSpace(Path(folder) / "free_space", rig)
        for _ in range(3):
            fused = fusion.add(wall, rig, np.eye(4))
            free.add(fused.depth_m, np.eye(4))
        points = MapPoints(sigma=1e3).of(fused, _texture()[:, :_WIDTH])
        places = points.in_map(np.eye(4))[0]
        in_front = free.empty(np.concatenate([places[:100], 0.5 * places[:100]]))
        free.close()
    depth_m = _FOCAL_PX * _BASELINE_M / _SHIFT_PX
    on_wall = np.allclose(places[:, 2], depth_m, rtol=1e-3)
    return on_wall and not in_front[:100].any() and bool(in_front[100:].all())


def _texture() -> UInt8:
    """Smooth random colours, wider than the picture by the shift."""
    noise = np.random.default_rng(_SEED).integers(0, 256, (_HEIGHT, _WIDTH + _SHIFT_PX, 3))
    smooth = noise + np.roll(noise, 1, axis=0) + np.roll(noise, 1, axis=1)
    return (smooth // 3).astype(np.uint8)


def _check(fine: bool, what: str) -> None:
    if not fine:
        raise StructureError(f"trial failed: {what}", want="the known result")


def main(name: str) -> dict[str, str]:
    """Run one trial: `found` holds what worked, or `got` and `fix` what did not."""
    try:
        return {"found": TRIALS[name]()}
    except PseudolidarError as error:
        return {"got": error.got, "fix": error.fix}
    except ImportError as error:
        return {"got": str(error), "module": (error.name or "").partition(".")[0], "fix": ""}


if __name__ == "__main__":
    sys.stdout.write("\n" + json.dumps(main(sys.argv[1])) + "\n")
