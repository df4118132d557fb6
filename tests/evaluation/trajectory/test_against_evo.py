"""Side by side with evo's own commands, run as a user runs them, on the same files."""

from __future__ import annotations

import json
import os
import subprocess
import sysconfig
import zipfile
from pathlib import Path

import numpy as np
import pytest
from pseudolidar.pipelines.evaluate import Evaluate, run

from pseudolidar.evaluation.trajectory.pairing import TimePairing
from pseudolidar.evaluation.trajectory.steps import RpeChoice
from pseudolidar.formats.trajectory import write_kitti_poses
from pseudolidar.formats.tum import write_tum_trajectory
from pseudolidar.running.trajectory_judging import Poses
from tests.evaluation.trajectory.paths import drifting, stamps, winding

NAMES = ("rmse", "mean", "median", "max", "min", "std")


@pytest.fixture(scope="session")
def evo(tmp_path_factory):
    """Statistics that a command of evo writes."""
    scripts = Path(sysconfig.get_path("scripts"))
    if not (scripts / "evo_ape").is_file():
        pytest.skip("evo is not installed: pip install pseudolidar[test]")
    home = tmp_path_factory.mktemp("evo")

    def statistics(tool: str, form: str, reference: Path, estimate: Path, *flags: str) -> dict:
        out = home / f"{len(list(home.iterdir()))}.zip"
        command = [scripts / tool, form, reference, estimate, *flags, "--save_results", out]
        done = subprocess.run(
            [*map(str, command), "--no_warnings", "--silent"],
            env={**os.environ, "HOME": str(home)},
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert out.is_file(), done.stdout + done.stderr
        with zipfile.ZipFile(out) as archive:
            return json.loads(archive.read("stats.json"))

    return statistics


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> Path:
    """Two files of one path: every third pose, late by some ms; a scale that is 3 % off."""
    folder = tmp_path_factory.mktemp("paths")
    truth = winding(600, step_m=0.4)
    estimate = drifting(truth)
    estimate[:, :3, 3] *= 0.97
    times_ns = stamps(600)
    jitter_ns = np.random.default_rng(5).integers(-15_000_000, 15_000_000, 200)
    write_tum_trajectory(folder / "truth.tum", times_ns, truth)
    write_tum_trajectory(folder / "estimate.tum", times_ns[1::3] + jitter_ns, estimate[1::3])
    write_kitti_poses(folder / "truth.txt", truth)
    write_kitti_poses(folder / "estimate.txt", estimate)
    return folder


def ours(estimate: Path, reference: Path, **settings) -> dict:
    job = Evaluate("trajectory", Poses(estimate), reference=reference, **settings)
    return run(job).as_dict()


def same(mine: dict, theirs: dict, unit: str, *, tolerance: float = 1e-6) -> None:
    assert {name: mine[f"{name}_{unit}"] for name in NAMES} == pytest.approx(
        {name: theirs[name] for name in NAMES}, abs=tolerance
    )


def test_absolute_errors_by_time(evo, files):
    est, ref = files / "estimate.tum", files / "truth.tum"
    found = ours(est, ref, align="sim3")
    assert 100 < found["frames"] < 200  # some are further apart than 10 ms
    assert found["scale"] == pytest.approx(1 / 0.97, abs=0.02)
    same(found["ape"], evo("evo_ape", "tum", ref, est, "-a", "-s"), "m")


def test_relative_errors_by_path(evo, files):
    est, ref = files / "estimate.txt", files / "truth.txt"
    found = ours(est, ref, align="none", rpe=RpeChoice.parse("10m"))
    assert found["rpe"]["n"] > 20
    same(found["rpe"], evo("evo_rpe", "kitti", ref, est, "-d", "10", "-u", "m"), "m")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("align", "flags"),
    [("none", ()), ("origin", ("--align_origin",)), ("se3", ("-a",)), ("sim3", ("-a", "-s"))],
)
def test_every_alignment(evo, files, align, flags):
    for form, suffix in (("kitti", "txt"), ("tum", "tum")):
        est, ref = files / f"estimate.{suffix}", files / f"truth.{suffix}"
        found = ours(est, ref, align=align, rpe=RpeChoice.parse("1,20,5m,5m:all"))
        same(found["ape"], evo("evo_ape", form, ref, est, *flags), "m")
        turned = evo("evo_ape", form, ref, est, *flags, "-r", "angle_deg")
        same(found["ape"], turned, "deg")
        steps = (("1", "f", ()), ("20", "f", ()), ("5", "m", ()), ("5", "m", ("--all_pairs",)))
        for mine, (delta, unit, more) in zip(found["rpe"]["by_step"], steps, strict=True):
            over = ("-d", delta, "-u", unit, *more)
            same(mine, evo("evo_rpe", form, ref, est, *flags, *over), "m")
            turned = evo("evo_rpe", form, ref, est, *flags, *over, "-r", "angle_deg")
            same(mine, turned, "deg")


@pytest.mark.slow
def test_interpolated_poses(evo, files):
    est, ref = files / "estimate.tum", files / "truth.tum"
    found = ours(est, ref, pair=TimePairing("interpolate", max_difference_s=0.02))
    flags = ("-a", "--sync_method", "interpolation", "--t_max_diff", "0.02")
    same(found["ape"], evo("evo_ape", "tum", ref, est, *flags), "m", tolerance=1e-5)


@pytest.mark.slow
@pytest.mark.real
@pytest.mark.parametrize("name", ["ORB", "SPTAM"])
def test_real_estimates(evo, real_data, name):
    folder = real_data / "trajectories"
    est, ref = folder / f"KITTI_00_{name}.txt", folder / "KITTI_00_gt.txt"
    found = ours(est, ref)
    same(found["ape"], evo("evo_ape", "kitti", ref, est, "-a"), "m")
    same(found["rpe"], evo("evo_rpe", "kitti", ref, est), "m")
    over_10_m = found["rpe"]["by_step"][1]
    same(over_10_m, evo("evo_rpe", "kitti", ref, est, "-d", "10", "-u", "m"), "m")
