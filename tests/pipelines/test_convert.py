"""The conversion end to end on small real files: right clouds, right files, right refusals."""

import json
import pickle

import cv2
import numpy as np
import pytest
from pseudolidar.pipelines.convert import Convert, ConvertFrame, opened, run

from pseudolidar.errors import (
    CalibrationField,
    CalibrationSizeMismatch,
    OutputError,
    PairIdentical,
    StereoConfig,
    TooManyBadFrames,
    UsageError,
)
from pseudolidar.formats.pictures.depth_png import read_depth_png
from pseudolidar.formats.points.npz import read_npz
from pseudolidar.formats.points.pcd import read_pcd
from pseudolidar.formats.points.ply import read_ply
from pseudolidar.formats.points.velodyne_bin import read_velodyne_bin
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.running.reports.samples import read_samples, sampled_frames
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.selection import FrameSelection
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.stereo.sgbm import Bm, Sgbm

# Of the drive in conftest: Z = f B / d.
DEPTH_M = 100.0 * 0.5 / 9


def job(source, out, *, to="pcd", **options):
    return Convert(recognise(str(source)), out, to=Outputs.parse(to), workers=2, **options)


def report_of(out):
    return json.loads((out / "report.json").read_text())


def skips(out):
    return {skip["id"]: skip["code"] for skip in report_of(out)["skipped"]}


# --- right results ----------------------------------------------------------------------------


@pytest.mark.parametrize("matcher", [Census(), Census(quality="fine"), Sgbm(), Bm()])
@pytest.mark.parametrize("via", ["q", "p"])
def test_points_lie_on_the_plane(drive, tmp_path, matcher, via):
    few = FrameSelection.parse("0:2")
    result = run(job(drive, tmp_path, matcher=matcher, reproject=Reproject(via=via), frames=few))
    assert result.exit_code == 0
    cloud = read_pcd(tmp_path / "pcd" / "000001.pcd")
    assert cloud.frame == "camera_left"
    assert len(cloud) > 1000
    assert np.median(cloud.xyz[:, 2]) == pytest.approx(DEPTH_M, rel=0.01)
    assert np.isfinite(cloud.xyz).all()


def test_every_format_holds_the_same_cloud(drive, tmp_path):
    one = FrameSelection.parse("000003")
    run(job(drive, tmp_path, to="pcd:compressed,ply:ascii,npz,bin,depth,disparity", frames=one))
    pcd = read_pcd(tmp_path / "pcd" / "000003.pcd")
    for other in (
        read_ply(tmp_path / "ply" / "000003.ply"),
        read_npz(tmp_path / "npz" / "000003.npz"),
    ):
        assert np.array_equal(other.xyz, pcd.xyz)
        assert np.array_equal(other.rgb, pcd.rgb)
        assert np.allclose(other.sigma_m, pcd.sigma_m)
    velodyne = read_velodyne_bin(tmp_path / "bin" / "000003.bin")
    assert np.median(velodyne.xyz[:, 0]) == pytest.approx(DEPTH_M, rel=0.01), ".bin: x forward"
    depth = read_depth_png(tmp_path / "depth" / "000003.png")
    assert np.nanmedian(depth.values) == pytest.approx(DEPTH_M, rel=0.01)


def test_frames_of_clouds(drive, tmp_path):
    one = FrameSelection.parse("0:1")
    run(job(drive, tmp_path, frame="base_link", frames=one))
    cloud = read_pcd(tmp_path / "pcd" / "000000.pcd")
    assert cloud.frame == "base_link"
    assert np.median(cloud.xyz[:, 0]) == pytest.approx(DEPTH_M, rel=0.01)
    with pytest.raises(CalibrationField, match="--frame camera_left"):
        run(job(drive, tmp_path / "other", frame="velodyne"))
    assert not (tmp_path / "other").exists()


def test_a_recording_tells_no_place(own_drive, tmp_path):
    rig = (own_drive / "rig.json").rename(tmp_path / "mine.json")
    source = Folders(str(own_drive / "left"), right=str(own_drive / "right"), rig=str(rig))
    out = tmp_path / "out"
    run(Convert(source, out, to=Outputs.parse("mcap"), frames=FrameSelection.parse("0:1")))
    (recording,) = out.glob("*.mcap")
    assert str(tmp_path).encode() not in recording.read_bytes()


def test_a_rig_file_serves_folders_that_have_none(own_drive, tmp_path):
    rig = (own_drive / "rig.json").rename(tmp_path / "mine.json")
    run(job(own_drive, tmp_path / "out", rig=rig, frames=FrameSelection.parse("0:1")))
    cloud = read_pcd(tmp_path / "out" / "pcd" / "000000.pcd")
    assert np.median(cloud.xyz[:, 2]) == pytest.approx(DEPTH_M, rel=0.02)


def test_a_rig_file_replaces_the_calibration(drive, tmp_path):
    rig = json.loads((drive / "rig.json").read_text())
    (tmp_path / "rig.json").write_text(json.dumps(rig | {"baseline_m": 1.0}))
    run(job(drive, tmp_path / "out", rig=tmp_path / "rig.json"))
    cloud = read_pcd(tmp_path / "out" / "pcd" / "000000.pcd")
    assert np.median(cloud.xyz[:, 2]) == pytest.approx(2 * DEPTH_M, rel=0.01)


def test_selection(drive, tmp_path):
    chosen, without = FrameSelection.parse("0:10:3"), FrameSelection.parse("6")
    run(job(drive, tmp_path, frames=chosen, exclude=without))
    names = sorted(path.stem for path in (tmp_path / "pcd").iterdir())
    assert names == ["000000", "000003", "000009"]


def test_per_frame_work_can_be_sent_to_another_process(drive):
    task = job(drive, None, to="pcd,mcap")
    source = opened(task)
    work = pickle.loads(pickle.dumps(ConvertFrame.of(task, source)))
    here = ConvertFrame.of(task, source)(source.load(2))
    there = work(pickle.loads(pickle.dumps(source)).load(2))
    assert [file.crc32 for file in here.files] == [file.crc32 for file in there.files]
    (part,), (same,) = here.parts.values(), there.parts.values()
    assert b"".join(part.parts) == b"".join(same.parts)
    assert here.nbytes == sum(len(file.data) for file in here.files) + part.nbytes


def test_run_json_repeats_the_run(drive, tmp_path):
    from pseudolidar.running.settings_json import from_json

    task = job(drive, tmp_path, matcher=Sgbm(block_size=3), frames=FrameSelection.parse("0:2"))
    run(task)
    settings = json.loads((tmp_path / "run.json").read_text())["settings"]
    assert from_json(Convert, settings) == task


def test_reports_tell_every_frame(drive, tmp_path):
    report = run(job(drive, tmp_path))
    density = report.result.figures["density"]["mean"]
    told = report_of(tmp_path)
    assert [frame["id"] for frame in told["per_frame"]] == [f"{i:06d}" for i in range(14)]
    frame = told["per_frame"][3]
    assert frame["points"] == len(read_pcd(tmp_path / "pcd" / "000003.pcd"))
    assert sum(frame["depth_histogram"]) + frame["pixels_without_disparity"] == 128 * 64
    assert told["figures"]["density"]["mean"] == pytest.approx(density)
    assert report.as_dict()["committed"] == 14
    assert str(tmp_path / "pcd") in report.text()


# --- bad frames (rows 1, 2, 8, 9, 10, 12, 15, 45) ---------------------------------------------


def damage_missing(drive):
    (drive / "right" / "000002.png").unlink()


def damage_garbage(drive):
    (drive / "left" / "000002.png").write_bytes(b"no picture at all")


def damage_cut(drive):
    path = drive / "left" / "000002.png"
    path.write_bytes(path.read_bytes()[:-5000])


def damage_size(drive):
    path = drive / "right" / "000002.png"
    cv2.imwrite(str(path), cv2.imread(str(path))[:-2])


def damage_identical(drive):
    (drive / "right" / "000002.png").write_bytes((drive / "left" / "000002.png").read_bytes())


def damage_black(drive):
    for eye, level in (("left", 0), ("right", 1)):
        cv2.imwrite(str(drive / eye / "000002.png"), np.full((64, 128, 3), level, np.uint8))


@pytest.mark.parametrize(
    ("damage", "code"),
    [
        (damage_missing, "ImageMissing"),
        (damage_garbage, "ImageUnreadable"),
        (damage_cut, "ImageTruncated"),
        (damage_size, "PairMismatch"),
        (damage_identical, "PairIdentical"),
        (damage_black, "LowTexture"),
    ],
)
def test_a_bad_frame_is_skipped_and_reported(own_drive, tmp_path, damage, code):
    damage(own_drive)
    out = tmp_path / "out"
    report = run(job(own_drive, out, to="pcd,bin,mcap"))
    assert report.exit_code == 4
    assert skips(out) == {"000002": code}
    assert "000002" in report.text()
    assert not list(out.rglob("000002.*")), "a skipped frame leaves no file"
    assert len(list((out / "pcd").iterdir())) == 5
    again = run(job(own_drive, out, to="pcd,bin,mcap"))
    assert again.exit_code == 4
    assert again.result.passed_now == 0


def test_a_mended_frame_gets_its_place(own_drive, tmp_path):
    out, whole = tmp_path / "out", tmp_path / "whole"
    run(job(own_drive, whole, to="pcd,mcap"))
    kept = (own_drive / "left" / "000002.png").read_bytes()
    damage_cut(own_drive)
    assert run(job(own_drive, out, to="pcd,mcap")).exit_code == 4
    (own_drive / "left" / "000002.png").write_bytes(kept)
    assert run(job(own_drive, out, to="pcd,mcap")).exit_code == 0
    assert (out / "tiny.mcap").read_bytes() == (whole / "tiny.mcap").read_bytes()
    assert skips(out) == {}


def test_on_error_stop_raises_and_keeps_what_is_done(own_drive, tmp_path):
    damage_identical(own_drive)
    with pytest.raises(PairIdentical):
        run(job(own_drive, tmp_path / "out", on_error="stop"))
    names = sorted(path.name for path in (tmp_path / "out" / "pcd").iterdir())
    assert names == ["000000.pcd", "000001.pcd"]
    assert report_of(tmp_path / "out")["exit_code"] == 3


def test_too_many_bad_frames_stop_the_run_and_are_reported(own_drive, tmp_path):
    for index in range(5):
        path = own_drive / "left" / f"{index:06d}.png"
        path.write_bytes(path.read_bytes()[: -1000 * (index + 1)] if index else b"")
    with pytest.raises(TooManyBadFrames):
        run(job(own_drive, tmp_path / "out"))
    assert len(skips(tmp_path / "out")) == 5


def test_all_images_of_another_size_are_refused(own_drive, tmp_path):
    rig = json.loads((own_drive / "rig.json").read_text())
    (own_drive / "rig.json").write_text(json.dumps(rig | {"width_px": 130}))
    with pytest.raises(CalibrationSizeMismatch, match="--scale-calibration"):
        run(job(own_drive, tmp_path / "out"))


def test_an_image_narrower_than_the_search_is_refused(drive, tmp_path):
    with pytest.raises(StereoConfig, match="at most"):
        run(job(drive, tmp_path, matcher=Census(disparities=256)))


# --- before the start -------------------------------------------------------------------------


def test_a_dry_run_tells_and_writes_nothing(drive, tmp_path):
    out = tmp_path / "out"
    told = run(job(drive, out, to="pcd,mcap", dry_run=True))
    assert not out.exists()
    run(job(drive, out, to="pcd,mcap"))
    written = sum(p.stat().st_size for p in [*out.rglob("*.pcd"), *out.glob("*.mcap")])
    assert told.frames == 14
    assert told.bytes == pytest.approx(written, rel=0.2)
    assert told.exit_code == 0
    assert "14 frames" in told.text()
    assert told.as_dict()["free_bytes"] > 0


@pytest.mark.parametrize("dry_run", [True, False])
def test_what_will_not_fit_is_refused_before_the_start(drive, tmp_path, monkeypatch, dry_run):
    from pseudolidar.running import rehearsal

    monkeypatch.setattr(rehearsal, "free_bytes", lambda _: 100_000)
    with pytest.raises(OutputError, match="100000 are free") as caught:
        run(job(drive, tmp_path / "out", dry_run=dry_run))
    assert caught.value.exit_code == 5
    assert not (tmp_path / "out" / "pcd").exists()


@pytest.mark.parametrize("text", ["", "pcd,xyz", "pcd,pcd:ascii", "ply,ply", "MCAP"])
def test_outputs_that_cannot_be_meant(text):
    with pytest.raises(UsageError):
        Outputs.parse(text)


def test_outputs_as_text():
    outputs = Outputs.parse(" pcd:ascii, mcap")
    assert str(outputs) == "pcd:ascii,mcap"
    assert outputs.recording
    assert outputs.files == ("pcd:ascii",)


# --- samples for the report -------------------------------------------------------------------


def test_samples_are_few_and_cover_the_sequence(drive, tmp_path):
    ids = [f"{i:06d}" for i in range(5000)]
    chosen = sampled_frames(ids)
    assert len(chosen) == 12
    assert {ids[0], ids[-1]} <= chosen
    assert sampled_frames(ids[:3]) == set(ids[:3])
    assert sampled_frames([]) == frozenset()
    run(job(drive, tmp_path))
    samples = read_samples(tmp_path, [FrameRecord("000000", 0), FrameRecord("000001", 1)])
    sample = samples["000000"]
    assert sample.photo.shape == (64, 128, 3)
    assert np.nanmedian(sample.disparity) == pytest.approx(9, abs=0.1)
    assert sample.ahead_m == 10, "so that the wall of 7 m, 5.6 m away, fills it"
    ahead = int((10 - DEPTH_M) / (10 / 160))
    assert sample.top[ahead - 3 : ahead + 4].sum() > 0.9 * sample.top.sum()
    assert (sample.top.sum(axis=0) > 0).sum() > 90
