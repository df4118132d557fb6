"""What the filters of dense maps and the cloud tools gain and cost, on real data and a street.

    python -m tests.benchmarks.dense [smooth] [fill] [temporal] [ground] [beams] [time]

D1 on KITTI stereo 2015 and Middlebury's motorcycle; honesty of sigma with the rig's error fitted on
even frames, judged on odd ones; fusion against Velodyne on KITTI raw drive 0002 and against exact
truth on a street; the ground against Velodyne's; beams against a real scan; milliseconds in turn
with the matcher.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np

from pseudolidar.calibration.refine import fit
from pseudolidar.clouds.beams import Beams
from pseudolidar.clouds.ground import Label
from pseudolidar.clouds.normals import Normals
from pseudolidar.clouds.thin import Density, Uniform, Voxel
from pseudolidar.evaluation.disparity import disparity_errors
from pseudolidar.evaluation.lidar import scan_samples
from pseudolidar.evaluation.sigma import sigma_shares
from pseudolidar.geometry.cloud_frames import left_in
from pseudolidar.geometry.frames import frame_tree
from pseudolidar.geometry.gaps import filled
from pseudolidar.geometry.projection import project_scan
from pseudolidar.sources.recognise import recognise
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.filled_map import Surfaces
from pseudolidar.stereo.filters.filling_kernels import OCCLUSION, SURFACE
from pseudolidar.stereo.filters.smoothed_map import Fgs
from pseudolidar.stereo.filters.temporal import Kalman
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.samples import DisparitySamples
from tests.conftest import DATA
from tests.stereo.motorcycle import DISPARITIES
from tests.stereo.motorcycle import motorcycle as read_motorcycle

ROUNDS = 7
Matched = Sequence[tuple[StereoFrame, DisparityMap]]


def frames_of(path: str) -> list[StereoFrame]:
    source = recognise(path).open()
    return [source.load(index) for index in range(len(source.ids))]


def matched(path: str) -> Matched:
    matcher = Census().load()
    return [(frame, matcher(frame)) for frame in frames_of(path)]


def kitti() -> Matched:
    return matched(str(DATA / "kitti_stereo2015" / "training"))


def motorcycle() -> Matched:
    frame = read_motorcycle(DATA)
    return [(frame, Census(disparities=DISPARITIES).load()(frame))]


def print_score(name: str, pairs: Matched, filter_: Callable[..., DisparityMap]) -> None:
    errors = [disparity_errors(filter_(frame, d), frame.truth) for frame, d in pairs]
    columns = [(100 * e.d1_est, 100 * e.density, e.epe, 100 * e.d1_filled) for e in errors]
    est, density, epe, fill = np.mean(columns, axis=0)
    print(f"  {name:34s} D1 {est:5.2f} %  density {density:5.1f} %  EPE {epe:5.3f} px  ", end="")
    print(f"D1 filled {fill:5.2f} %")


def print_sigma(name: str, pairs: Matched, filter_: Callable[..., DisparityMap]) -> None:
    """Shares within sigma and the 95 % radius: pixels with a match, and those without."""
    samples = [
        DisparitySamples.of_maps(d, frame.truth, frame=i, most=20_000)
        for i, (frame, d) in enumerate(pairs)
    ]
    correction = fit(DisparitySamples.concatenate(samples[::2]))
    for where in ("with a match", "without"):
        error, sigma = [], []
        for frame, d in pairs[1::2]:
            out = filter_(frame, d)
            at = d.valid if where == "with a match" else ~d.valid
            kept = replace(out, values=np.where(at, out.values, np.float32(np.nan)))
            s = DisparitySamples.of_maps(kept, frame.truth, frame=0)
            offset = correction.offset_px(s.measured, s.u, s.v, s.size_px)
            error.append(s.measured - offset - s.reference)
            sigma.append(s.sigma)
        shares = sigma_shares(np.concatenate(error), np.concatenate(sigma))
        if shares.n:
            print(f"  {name:20s} {where:13s} within sigma {shares.within_1_sigma:.3f}, ", end="")
            print(
                f"95 % radius {shares.within_95:.3f}, median {np.median(np.hstack(sigma)):.2f} px"
            )


def smooth() -> None:
    chosen = {
        "smooth fgs": Fgs(),
        "smooth fgs:3000": Fgs(strength=3000),
        "smooth fgs, dense": Fgs(dense=True),
    }
    for name, pairs in (("KITTI stereo 2015", kitti()), ("Middlebury motorcycle", motorcycle())):
        print(name)
        print_score("matched", pairs, lambda _, d: d)
        print_score("row's minimum", pairs, lambda _, d: DisparityMap(filled(d.values)))
        for label, settings in chosen.items():
            smoother = settings.load()
            print_score(label, pairs, lambda f, d, s=smoother: s(f, d).disparity)
        if name.startswith("KITTI"):
            print_sigma("matched", pairs, lambda _, d: d)
            print_sigma("smooth fgs, dense", pairs, lambda f, d, s=smoother: s(f, d).disparity)


def fill() -> None:
    filler = Surfaces().load()
    for name, pairs in (("KITTI stereo 2015", kitti()), ("Middlebury motorcycle", motorcycle())):
        print(name)
        print_score("fill surfaces", pairs, lambda f, d: filler(f, d).disparity)
        for kind, label in ((SURFACE, "planes"), (OCCLUSION, "shadows")):
            wrong = []
            for frame, d in pairs:
                filling, truth = filler.filling(frame, d), frame.truth.values
                at = (filling.kind == kind) & frame.truth.valid
                for values in (filling.values, filled(d.values)):
                    error = np.abs(values - truth)[at]
                    wrong.append((error > 3) & (error > 0.05 * truth[at]))
            ours, rows = np.concatenate(wrong[::2]), np.concatenate(wrong[1::2])
            print(
                f"  {label}: {len(ours)} pixels with truth, D1 {100 * ours.mean():.2f} %, ", end=""
            )
            print(f"row's minimum there {100 * rows.mean():.2f} %")
        if name.startswith("KITTI"):
            print_sigma("fill surfaces", pairs, lambda f, d: filler(f, d).disparity)


def plane_thickness_mm(xyz: np.ndarray) -> tuple[float, float]:
    """Median standard deviation across level and upright planes in cubes of 0.4 m, camera axes."""
    cells = np.floor(xyz / 0.4).astype(int)
    order = np.lexsort(cells.T)
    cuts = np.flatnonzero(np.any(np.diff(cells[order], axis=0), axis=1)) + 1
    level, upright = [], []
    for points in np.split(xyz[order], cuts):
        if len(points) >= 40:
            variances, axes = np.linalg.eigh(np.cov(points.T))
            if variances[1] > 4 * variances[0]:
                (level if abs(axes[1, 0]) > 0.8 else upright).append(np.sqrt(variances[0]))
    return 1e3 * float(np.median(level)), 1e3 * float(np.median(upright))


class Frames:
    def __init__(self, frames: Sequence[StereoFrame]) -> None:
        self.frames = frames

    def load(self, index: int) -> StereoFrame:
        return self.frames[index]


def temporal() -> None:
    window = Kalman().window
    for name, path in (
        ("KITTI raw drive 0002", str(DATA / "kitti_raw" / "2011_09_26")),
        ("synthetic street", "synthetic:street:10"),
    ):
        frames = frames_of(path)
        fuse = Kalman().load(Census().load(), Frames(frames))
        before = [fuse.sightings(frame) for frame in frames]
        after = [fuse(frame, d).disparity for frame, d in zip(frames, before, strict=True)]
        kept = [
            replace(new, values=np.where(old.valid, new.values, np.float32(np.nan)))
            for new, old in zip(after, before, strict=True)
        ]
        stages = {"matched": before, "fused": kept, "fused and carried over": after}
        print(f"{name}, frames {window - 1} to 9, window {window}")
        full = range(window - 1, 10)
        if name.startswith("synthetic"):
            for label, maps in stages.items():
                print_score(label, [(frames[i], maps[i]) for i in full], lambda _, d: d)
            continue
        stock = [scan_samples(before[i], frames[i], frame_number=i) for i in range(10)]
        correction = fit(DisparitySamples.concatenate(stock))
        reproject = Reproject(max_range_m=15.0).load()
        for label, maps in stages.items():
            s = DisparitySamples.concatenate(
                [scan_samples(maps[i], frames[i], frame_number=i) for i in full]
            )
            error = s.measured - correction.offset_px(s.measured, s.u, s.v, s.size_px) - s.reference
            relative = np.abs(error) / s.reference
            depth_m = frames[0].rig.fB_px_m / s.reference
            bins = ((5, 10), (10, 20), (20, 30), (30, 50), (50, 80))
            by_range = " / ".join(
                f"{100 * np.median(relative[(depth_m >= a) & (depth_m < b)]):.2f}" for a, b in bins
            )
            shares = sigma_shares(error, s.sigma)
            thick = np.mean(
                [plane_thickness_mm(reproject(frames[i], maps[i]).xyz) for i in full], axis=0
            )
            print(
                f"  {label:24s} median |dz|/z at 5-10/-20/-30/-50/-80 m: {by_range} %; planes ",
                end="",
            )
            print(f"{thick[0]:.1f} mm level, {thick[1]:.1f} mm upright; within sigma ", end="")
            print(f"{shares.within_1_sigma:.3f}, 95 % radius {shares.within_95:.3f}")


def ground() -> None:
    label, reproject = Label().load(), Reproject().load()
    for name in ("kitti_stereo2015/training", "kitti_raw/2011_09_26"):
        angles, heights = [], []
        for frame, d in matched(str(DATA / name)):
            cloud = reproject(frame, d).transformed(left_in(frame.rig, "velodyne"))
            plane, _ = label.found(cloud, frame_tree(frame.rig))
            xyz = frame.scan.xyz
            ahead = (xyz[:, 0] > 0) & (np.abs(xyz[:, 1]) < 0.85 * xyz[:, 0])
            scan = PointCloud(np.ascontiguousarray(xyz[ahead]), "velodyne")
            reference, _ = label.found(scan, ())
            angles.append(np.degrees(np.arccos(min(1.0, plane.normal @ reference.normal))))
            heights.append((plane.offset_m, reference.offset_m))
        stereo, lidar = np.array(heights).T
        print(f"{name}: angle to Velodyne's ground {np.median(angles):.2f} deg (median), ", end="")
        print(f"{max(angles):.2f} (largest); height {np.median(stereo):.3f} m, Velodyne's ", end="")
        print(
            f"{np.median(lidar):.3f} m, median |difference| {np.median(abs(stereo - lidar)):.3f} m"
        )


def beams() -> None:
    reproject, edges = Reproject().load(), [0, 5, 10, 20, 30, 50, 80]
    ours, scans = np.zeros(6), np.zeros(6)
    for frame, d in matched(str(DATA / "kitti_raw" / "2011_09_26")):
        cloud = reproject(frame, d).transformed(left_in(frame.rig, "velodyne"))
        seen, _ = Beams(64)(cloud, frame_tree(frame.rig))
        scan = frame.scan.xyz[project_scan(frame.scan, frame.rig).index]
        ours += np.histogram(np.linalg.norm(seen.xyz, axis=1), edges)[0]
        scans += np.histogram(np.linalg.norm(scan, axis=1), edges)[0]
    print("64 beams of stereo against the scan's points in view, drive 0002, by range:")
    for low, high, a, b in zip(edges[:-1], edges[1:], ours, scans, strict=True):
        print(f"  {low}-{high} m: {a / 10:.0f} and {b / 10:.0f} a frame, {a / max(b, 1):.2f}")


def times() -> None:
    cv2.setNumThreads(1)
    frames = frames_of(str(DATA / "kitti_raw" / "2011_09_26"))[:6]
    fuse = Kalman().load(Census().load(), Frames(frames))
    pair = frames[5]
    matcher, reproject = Census().load(), Reproject().load()
    d = matcher(pair)
    cloud, tree = (
        reproject(pair, d).transformed(left_in(pair.rig, "velodyne")),
        frame_tree(pair.rig),
    )
    tools = {
        "ground label": Label().load(),
        "normals": Normals().load(),
        "beams 64": Beams(64).load(),
        "thin voxel:0.1": Voxel(0.1).load(),
        "thin uniform": Uniform(),
        "thin density": Density(),
    }
    smoother, dense, filler = Fgs().load(), Fgs(dense=True).load(), Surfaces().load()
    calls: dict[str, Callable[[], object]] = {
        "match, census fast": lambda: matcher(pair),
        "smooth fgs": lambda: smoother(pair, d),
        "smooth fgs, dense": lambda: dense(pair, d),
        "fill surfaces": lambda: filler(pair, d),
        "temporal kalman:5": lambda: fuse(pair, d),
    } | {name: lambda tool=tool: tool(cloud, tree) for name, tool in tools.items()}
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(ROUNDS):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            seconds[name].append(time.perf_counter() - begin)
    base = np.array(seconds["match, census fast"])
    print(f"{len(cloud)} points; min ms, and ratio to the matcher (median of {ROUNDS} rounds)")
    for name, values in seconds.items():
        print(f"  {name:22s} {1e3 * min(values):7.1f} {np.median(np.array(values) / base):6.2f}")


PARTS = {f.__name__: f for f in (smooth, fill, temporal, ground, beams)} | {"time": times}


def main() -> None:
    """Print the parts that are asked for, or all."""
    for name in sys.argv[1:] or PARTS:
        PARTS[name]()


if __name__ == "__main__":
    main()
