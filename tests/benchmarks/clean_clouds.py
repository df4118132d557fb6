"""What default cleaning removes and keeps, judged by LiDAR scans, labels and exact truth; its time.

    python -m tests.benchmarks.clean_clouds [--sensitivity]

KITTI frames with a scan (stereo 2015, raw drive 0002), on the stock rig and on one refined by the
other half of the frames; object pixels of KITTI (`obj_map`); the synthetic street with its exact
depth, thin things and persons apart. Beside it, Open3D's outlier removal on the same clouds. Shares
of the points before cleaning, pooled over frames. Without the real data only the street.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from scipy.ndimage import grey_opening

from pseudolidar.calibration.refine import fit
from pseudolidar.evaluation.ghosts import GHOST_M, GHOST_REL, judge_points
from pseudolidar.evaluation.lidar import scan_samples
from pseudolidar.evaluation.scan_surface import ScanSurface
from pseudolidar.geometry.depth import depth_map
from pseudolidar.geometry.open3d_library import load_open3d
from pseudolidar.running.memory import keep_freed_memory
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.clean import REASONS, Clean
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.structures.arrays import Bool, UInt8
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.samples import DisparitySamples
from tests.conftest import DATA

BANDS_M = ((0, 30), (30, 80))
STREET_SEEDS, STREET_FRAMES = (0, 1, 2, 3), (5, 25)
# A thin thing of the street is nearer than what is on both sides of it within so many columns.
THIN_PX = 12
ROUNDS = 15
# Settings that are halved and doubled.
VARIED = ("angle_deg", "gap_sigmas", "edge_error", "far_error", "speckle_m2", "neighbours")


@dataclass(frozen=True, eq=False)
class Judged:
    """A frame with its disparity, and for pixels what they are.

    Args:
        frame: the pair.
        disparity: as the matcher found it.
        bad: by name, (H, W) pixels that are wrong.
        good: by name, (H, W) pixels that are right.
        half: which half of the frames.
    """

    frame: StereoFrame
    disparity: DisparityMap
    bad: dict[str, Bool]
    good: dict[str, Bool]
    half: int = 0


def kitti_frames() -> Iterator[Judged]:
    """KITTI frames with a scan, judged along the ray and in any direction, on both rigs."""
    stereo = DATA / "kitti_stereo2015"
    drive = DATA / "kitti_raw" / "2011_09_26" / "2011_09_26_drive_0002_sync"
    for source in (KittiStereo(str(stereo)).open(), KittiRaw(str(drive)).open()):
        matcher = Census().load()
        frames = [source.load(i) for i in range(len(source.ids))]
        maps = [matcher(frame) for frame in frames]
        samples = [
            scan_samples(disparity, frame, frame_number=i)
            for i, (frame, disparity) in enumerate(zip(frames, maps, strict=True))
        ]
        corrections = [fit(DisparitySamples.concatenate(samples[k::2])) for k in (1, 0)]
        for i, (frame, disparity) in enumerate(zip(frames, maps, strict=True)):
            surface = ScanSurface.of(frame)
            bad, good = {}, {}
            for rig, correction in (("stock", None), ("refined", corrections[i % 2])):
                seen = replace(frame, rig=frame.rig.with_correction(correction))
                cloud = Reproject().load()(seen, disparity)
                found = judge_points(cloud, seen, surface)
                for low, high in BANDS_M:
                    band = (found.range_m >= low) & (found.range_m < high) & found.judged
                    for kind, off in (("along the ray", found.stray), ("any way", found.ghost)):
                        name = f"{rig} rig, {kind}, {low}-{high} m"
                        bad[name] = pixels(cloud, band & off, disparity)
                        good[name] = pixels(cloud, band & ~off, disparity)
            good |= object_pixels(frame, disparity)
            yield Judged(frame, disparity, bad, good, half=i % 2)


def pixels(cloud: PointCloud, chosen: Bool, disparity: DisparityMap) -> Bool:
    """(H, W) pixels of the chosen points."""
    assert cloud.uv is not None
    image = np.zeros(disparity.values.shape, np.bool_)
    column, row = np.rint(cloud.uv[chosen]).astype(np.intp).T
    image[row, column] = True
    return image


def object_pixels(frame: StereoFrame, disparity: DisparityMap) -> dict[str, Bool]:
    """Pixels of labelled cars that the truth confirms, in bands of their depth."""
    path = DATA / "kitti_stereo2015" / "training" / "obj_map" / f"{frame.id}.png"
    if frame.truth is None or not path.exists():
        return {}
    objects = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) > 0
    true_m, depth_m = (depth_map(m, frame.rig).values for m in (frame.truth, disparity))
    right = objects & (np.abs(depth_m - true_m) <= GHOST_M + GHOST_REL * true_m)
    return {
        f"pixels of cars, {low}-{high} m": right & (true_m >= low) & (true_m < high)
        for low, high in BANDS_M
    }


def street_frames() -> Iterator[Judged]:
    """The synthetic street, judged by its exact depth."""
    matcher = Census().load()
    for seed in STREET_SEEDS:
        source = Synthetic("street", frames=max(STREET_FRAMES) + 1, seed=seed).open()
        for index in STREET_FRAMES:
            frame = source.load(index)
            disparity = matcher(frame)
            assert frame.truth is not None
            true_m = depth_map(frame.truth, frame.rig).values
            depth_m = depth_map(disparity, frame.rig).values
            near = np.isfinite(depth_m) & (depth_m < BANDS_M[-1][1])
            sky = near & np.isnan(true_m)
            off = near & (np.abs(depth_m - true_m) > GHOST_M + GHOST_REL * depth_m)
            right = near & ~sky & ~off
            bad, good = {"street, sky": sky}, {}
            for low, high in BANDS_M:
                band = (depth_m >= low) & (depth_m < high)
                bad[f"street, {low}-{high} m"] = off & band
                good[f"street, {low}-{high} m"] = right & band
            true_px = np.nan_to_num(frame.truth.values)
            before = true_px - grey_opening(true_px, size=(1, THIN_PX + 1))
            thin = (before > np.maximum(1.5, 0.1 * true_px)) & (true_m < BANDS_M[0][1])
            good["street, thin things to 30 m"] = right & thin
            persons = np.zeros_like(thin)
            for label in frame.labels or ():
                mask = label.detection.mask
                if mask is not None and label.detection.name == "Pedestrian":
                    persons |= mask
            good["street, persons"] = right & persons
            yield Judged(frame, disparity, bad, good)


Removal = Callable[[Judged], UInt8]


def by_cleaning(settings: Clean) -> Removal:
    """(H, W) reasons of cleaning."""
    cleaner = settings.load()
    return lambda judged: cleaner(judged.frame, judged.disparity).reason


def by_open3d(method: str, **options: Any) -> Removal:
    """(H, W) 1 where Open3D's outlier removal takes the point of a pixel."""
    o3d = load_open3d()

    def removal(judged: Judged) -> UInt8:
        cloud = Reproject().load()(judged.frame, judged.disparity)
        given = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.xyz.astype(np.float64)))
        _, kept = getattr(given, f"remove_{method}_outlier")(**options)
        gone = np.ones(len(cloud), np.bool_)
        gone[np.asarray(kept)] = False
        return pixels(cloud, gone, judged.disparity).astype(np.uint8)

    return removal


def shares(frames: list[Judged], removal: Removal) -> dict[tuple[str, str], np.ndarray]:
    """Pixels by what became of them (kept, then by reason), for each name."""
    counts: dict[tuple[str, str], np.ndarray] = {}
    for judged in frames:
        reason = removal(judged)
        for kind, masks in (("bad", judged.bad), ("good", judged.good)):
            for name, mask in masks.items():
                found = np.bincount(reason[mask], minlength=len(REASONS) + 1)
                counts[kind, name] = counts.get((kind, name), 0) + found
    return counts


def table(title: str, frames: list[Judged], removal: Removal) -> None:
    """Print what is left of bad and good pixels, and what took the others."""
    print(f"\n{title}, {len(frames)} frames")
    print(f"{'':5s}{'':38s}{'pixels':>9s}{'left':>8s}" + "".join(f"{n:>11s}" for n in REASONS))
    for (kind, name), counts in shares(frames, removal).items():
        total = max(int(counts.sum()), 1)
        gone = "".join(f"{share:>11.2%}" for share in counts[1:] / total)
        print(f"{kind:5s}{name:38s}{counts.sum():9d}{counts[0] / total:8.1%}{gone}")


def short(title: str, frames: list[Judged], removal: Removal, names: list[str]) -> None:
    """Print in one line what is left of bad and of good pixels."""
    counts = shares(frames, removal)
    cells = []
    for name in names:
        left = [
            f"{counts[k, name][0] / max(counts[k, name].sum(), 1):6.1%}"
            for k in ("bad", "good")
            if (k, name) in counts
        ]
        cells.append(" /".join(left))
    print(f"{title:34s}" + "   ".join(cells))


def times(frames: list[Judged]) -> None:
    """Print the time of cleaning against the matcher's, interleaved on one thread."""
    matcher, cleaner = Census().load(), Clean().load()
    ratios, matching, cleaning = [], [], []
    for judged in frames[:: max(1, len(frames) // 4)][:4]:
        disparity = matcher(judged.frame)
        cleaner(judged.frame, disparity)
        for _ in range(ROUNDS):
            begin = time.perf_counter()
            matcher(judged.frame)
            middle = time.perf_counter()
            cleaner(judged.frame, disparity)
            end = time.perf_counter()
            matching.append(middle - begin)
            cleaning.append(end - middle)
            ratios.append((end - middle) / (middle - begin))
    print(
        f"\ncleaning {1e3 * min(cleaning):.1f} ms, matcher (census fast, one thread) "
        f"{1e3 * min(matching):.1f} ms: ratio of minima {min(cleaning) / min(matching):.3f}, "
        f"median ratio {np.median(ratios):.3f}"
    )


def baselines(frames: list[Judged], names: list[str]) -> None:
    """Print Open3D's outlier removal at about as many good points kept, with its time."""
    print(f"\nleft of bad / of good: {'; '.join(names)}")
    short("cleaning, default", frames, by_cleaning(Clean()), names)
    options: list[tuple[str, dict[str, Any]]] = [
        ("statistical", {"nb_neighbors": 20, "std_ratio": 2.0}),
        ("statistical", {"nb_neighbors": 20, "std_ratio": 0.3}),
        ("statistical", {"nb_neighbors": 20, "std_ratio": 0.1}),
        ("radius", {"nb_points": 16, "radius": 0.2}),
        ("radius", {"nb_points": 30, "radius": 0.2}),
        ("radius", {"nb_points": 60, "radius": 0.3}),
    ]
    for method, chosen in options:
        begin = time.perf_counter()
        values = ", ".join(map(str, chosen.values()))
        short(f"open3d {method} ({values})", frames, by_open3d(method, **chosen), names)
        print(f"{'':34s}{(time.perf_counter() - begin) / len(frames):.2f} s a frame")


def sensitivity(frames: list[Judged], names: list[str]) -> None:
    """Print what halving and doubling each setting does."""
    print(f"\nleft of bad / of good: {'; '.join(names)}")
    short("default", frames, by_cleaning(Clean()), names)
    for setting in VARIED:
        default = getattr(Clean(), setting)
        for value in (default / 2, default * 2):
            chosen = replace(Clean(), **{setting: type(default)(value)})
            short(f"{setting} {value:g}", frames, by_cleaning(chosen), names)


def main() -> None:
    """Print all tables."""
    cv2.setNumThreads(1)
    keep_freed_memory()  # as in a run
    street = list(street_frames())
    table("synthetic street", street, by_cleaning(Clean()))
    names = [f"street, {low}-{high} m" for low, high in BANDS_M]
    people = ["street, thin things to 30 m", "street, persons"]
    real = list(kitti_frames()) if DATA.is_dir() else []
    if real:
        table("KITTI, all", real, by_cleaning(Clean()))
        for half in (0, 1):
            mine = [judged for judged in real if judged.half == half]
            table(f"KITTI, half {half}", mine, by_cleaning(Clean()))
    judged = real or street
    if real:
        names = [f"refined rig, along the ray, {low}-{high} m" for low, high in BANDS_M]
    baselines(judged[::4], names)
    if "--sensitivity" in sys.argv:
        sensitivity(judged, names)
        sensitivity(street, [f"street, {low}-{high} m" for low, high in BANDS_M] + people)
    times(judged)


if __name__ == "__main__":
    main()
