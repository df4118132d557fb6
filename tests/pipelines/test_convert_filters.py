"""The optional filters through the whole conversion: flags, counts, and the same bytes always."""

import json
import multiprocessing
import signal
import time

import numpy as np
import pytest
from pseudolidar.pipelines.convert import Convert, run

from pseudolidar.cli import main
from pseudolidar.formats.points.pcd import read_pcd
from pseudolidar.running.journal.journal_file import JOURNAL_NAME
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.sources.selection import FrameSelection
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.filled_map import Surfaces
from pseudolidar.stereo.filters.smoothed_map import Fgs
from pseudolidar.stereo.filters.temporal import Kalman

WORLD = Synthetic("street", frames=10, width_px=256)
OF_THE_RUN = {"run.json", "report.json", "report.html", JOURNAL_NAME}
CHILDREN = multiprocessing.get_context("forkserver")


def job(out, *, workers=2, frames=None, **filters):
    chosen = {"temporal": Kalman(window=4), "smooth": Fgs(), "fill": Surfaces()} | filters
    return Convert(
        WORLD,
        out,
        to=Outputs.parse("pcd,disparity,mcap"),
        matcher=Census(disparities=32),
        workers=workers,
        frames=None if frames is None else FrameSelection.parse(frames),
        **chosen,
    )


def tree(folder):
    files = {str(p.relative_to(folder)): p for p in folder.rglob("*") if p.is_file()}
    return {name: p.read_bytes() for name, p in files.items() if name not in OF_THE_RUN}


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    out = tmp_path_factory.mktemp("reference")
    assert run(job(out, workers=1)).exit_code == 0
    return out


def test_filters_are_counted_in_the_report(reference):
    figures = json.loads((reference / "report.json").read_text())["figures"]
    for name in ("pixels_fused", "pixels_carried_over", "pixels_smoothed"):
        assert figures[name]["max"] > 0, name
    assert figures["pixels_filled_on_surfaces"]["mean"] > 0
    assert figures["pixels_fused"]["min"] == 0  # the first frame has none before it
    assert "pixels fused" in (reference / "report.html").read_text()


def test_same_bytes_with_any_number_of_workers(reference, tmp_path):
    run(job(tmp_path / "out", workers=4))
    assert tree(tmp_path / "out") == tree(reference)


def test_same_bytes_after_a_kill(reference, tmp_path):
    task = job(tmp_path / "out")
    child = CHILDREN.Process(target=run, args=(task,))
    child.start()
    journal = tmp_path / "out" / JOURNAL_NAME
    deadline = time.monotonic() + 120
    while not (journal.exists() and journal.read_bytes().count(b"\n") >= 4):
        assert time.monotonic() < deadline
        assert child.is_alive()
        time.sleep(0.002)
    child.kill()
    child.join()
    assert child.exitcode == -signal.SIGKILL
    again = run(task)
    assert 0 < again.result.passed_now < WORLD.frames
    assert tree(tmp_path / "out") == tree(reference)


def test_a_frame_alone_is_what_it_is_in_the_sequence(reference, tmp_path):
    run(job(tmp_path / "out", frames="6:7"))
    name = WORLD.open().ids[6]
    for kind in (f"pcd/{name}.pcd", f"disparity/{name}.png"):
        assert (tmp_path / "out" / kind).read_bytes() == (reference / kind).read_bytes()


def test_flags_of_the_filters(tmp_path):
    out = tmp_path / "out"
    flags = "--temporal kalman:3 --smooth fgs:500 --smooth.dense --fill surfaces:20 --frames 2:4"
    source = ["--width-px", "256", "--matcher.disparities", "32"]
    assert main(["convert", "synthetic:street:4", str(out), *flags.split(), *source]) == 0
    settings = json.loads((out / "run.json").read_text())["settings"]
    assert settings["temporal"]["window"] == 3
    assert settings["smooth"]["strength"] == 500
    assert settings["smooth"]["dense"] is True
    assert settings["fill"]["largest_px"] == 20
    cloud = read_pcd(next((out / "pcd").iterdir()))
    assert np.isfinite(cloud.sigma_m).all()


def converted(tmp_path, *flags, source="synthetic:street:2"):
    out = tmp_path / "out"
    size = ["--width-px", "256", "--matcher.disparities", "32"] if "synthetic" in source else []
    assert main(["convert", source, str(out), *flags, *size, "--overwrite"]) == 0
    report = json.loads((out / "report.json").read_text())
    return [read_pcd(path) for path in sorted((out / "pcd").iterdir())], report["figures"]


def test_flags_of_the_cloud_tools(tmp_path):
    (whole, _), figures = converted(tmp_path, "--ground", "label", "--normals")
    assert {"ground", "nx", "ny", "nz"} <= whole.extra.keys()
    assert figures["ground_height_m"]["mean"] == pytest.approx(1.83, abs=0.4)  # small pictures
    (bare, _), _ = converted(tmp_path, "--ground", "remove", "--ground.fit.thickness-m", "0.15")
    assert len(bare) == len(whole) - whole.extra["ground"].sum()
    (box, _), _ = converted(tmp_path, "--crop", "box:5:20", "--crop.y=-4:4")
    assert box.xyz[:, 0].min() >= 5
    assert np.abs(box.xyz[:, 1]).max() <= 4
    (near, _), _ = converted(tmp_path, "--crop", "range:3:15", "--thin", "voxel:0.5")
    assert 0 < len(near) < len(whole)
    (some, _), _ = converted(tmp_path, "--thin", "uniform:500")
    assert len(some) == 500
    (even, _), _ = converted(tmp_path, "--thin", "density:500")
    assert len(even) == 500
    counts = [len(converted(tmp_path, "--beams", n)[0][0]) for n in ("64", "16", "4")]
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] > 0


def test_cloud_tools_serve_recorded_clouds_too(tmp_path):
    first = tmp_path / "first"
    flags = ["--width-px", "256", "--matcher.disparities", "32"]
    assert main(["convert", "synthetic:street:2", str(first), *flags]) == 0
    before = [read_pcd(path) for path in sorted((first / "pcd").iterdir())]
    after, figures = converted(
        tmp_path, "--ground", "label", "--thin", "voxel:0.5", "--normals", source=str(first / "pcd")
    )
    for whole, part in zip(before, after, strict=True):
        assert 0 < len(part) < len(whole)
        assert {"ground", "nx", "ny", "nz"} <= part.extra.keys()
        known = {row.tobytes() for row in whole.xyz}
        assert all(row.tobytes() in known for row in part.xyz)
    assert figures["points_thinned"]["min"] > 0


def test_a_box_in_a_frame_that_is_not_there_skips_with_a_reason(tmp_path, capsys):
    out = str(tmp_path / "out")
    flags = ["--crop", "box:0:9", "--crop.frame", "radar", "--width-px", "256"]
    assert main(["convert", "synthetic:street:1", out, *flags]) != 0
    assert "no transforms from 'velodyne' to 'radar'" in "".join(capsys.readouterr())


def test_temporal_without_poses_says_so(drive, tmp_path, capsys):
    assert main(["convert", str(drive), str(tmp_path / "out"), "--temporal", "kalman"]) == 3
    error = capsys.readouterr().err
    assert "PoseMissing" in error
    assert "Leave out --temporal" in error
