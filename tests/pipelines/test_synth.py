from pathlib import Path

import numpy as np
import pytest
from pseudolidar.pipelines.synth import Synth, run

from pseudolidar.errors import OutputSettings
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.source import FrameSource
from pseudolidar.structures.frame import StereoFrame

FRAMES = 2
# Not the rate that readers assume where there are no times.
RATE_HZ = 8.0
KINDS = {
    "raw": "kitti-raw",
    "odometry": "kitti-odometry",
    "object": "kitti-object",
    "stereo": "kitti-stereo",
}


@pytest.fixture(scope="module", params=list(KINDS))
def written(request, tmp_path_factory) -> tuple[str, FrameSource, FrameSource]:
    """The layout, the world, and what the KITTI readers make of its files."""
    out = tmp_path_factory.mktemp(request.param)
    job = Synth(out, layout=request.param, frames=FRAMES, width_px=480, seed=3, rate_hz=RATE_HZ)
    report = run(job)
    assert report.exit_code == 0
    assert report.as_dict()["committed"] == FRAMES
    return request.param, job.source.open(), recognise(str(out)).open()


def frames(source: FrameSource) -> list[StereoFrame]:
    return [source.load(index) for index in range(FRAMES)]


def test_it_is_recognised_and_complete(written) -> None:
    layout, world, read = written
    assert read.summary.kind == KINDS[layout]
    assert len(read.ids) == FRAMES
    assert read.refused == ()
    if layout in ("raw", "odometry"):  # the others have no times
        assert read.timestamps_ns == world.timestamps_ns


def test_pictures_and_scans_are_the_same(written) -> None:
    layout, world, read = written
    for made, got in zip(frames(world), frames(read), strict=True):
        np.testing.assert_array_equal(got.left, made.left)
        np.testing.assert_array_equal(got.right, made.right)
        np.testing.assert_array_equal(got.scan.xyz, made.scan.xyz)
        np.testing.assert_array_equal(got.scan.reflectance, made.scan.reflectance)
        if layout in ("raw", "odometry"):
            assert got.scan.timestamp_ns == made.scan.timestamp_ns


def test_calibration_is_the_same(written) -> None:
    _, world, read = written
    made, got = world.rig, read.load(1).rig
    np.testing.assert_allclose(got.P_left, made.P_left, atol=1e-9)
    np.testing.assert_allclose(got.P_right, made.P_right, atol=1e-9)
    np.testing.assert_allclose(got.T_left_velodyne.matrix, made.T_left_velodyne.matrix, atol=1e-9)


def test_each_layout_has_what_it_can_hold(written) -> None:
    layout, world, read = written
    made, got = world.load(1), read.load(1)
    if layout in ("raw", "odometry"):
        # OXTS holds degrees: 1e-14 of a turn is a nanometre on the ground, and some for the sums.
        np.testing.assert_allclose(got.pose.matrix, made.pose.matrix, atol=1e-6)
        assert got.pose.matrix[0, 3] > 0.5
    if layout == "stereo":
        np.testing.assert_allclose(got.truth.values, made.truth.values, atol=0.5 / 256 + 1e-6)
        assert np.array_equal(got.truth.valid, made.truth.valid)
    if layout == "object":
        assert len(got.labels) == len(made.labels) > 3
        for ours, theirs in zip(made.labels, got.labels, strict=True):
            assert theirs.detection.name == ours.detection.name
            assert theirs.detection.box_px == ours.detection.box_px
            assert theirs.occlusion == ours.occlusion
            assert theirs.truncation == pytest.approx(ours.truncation, abs=1e-9)
            centre, other = ours.box.pose.translation_m, theirs.box.pose.translation_m
            # KITTI's boxes stand upright in the camera; ours lean with the car's pitch and roll.
            assert np.linalg.norm(centre - other) < 0.03
            turned = ours.box.pose.matrix[:3, :3].T @ theirs.box.pose.matrix[:3, :3]
            assert np.arccos(np.clip((np.trace(turned) - 1) / 2, -1, 1)) < 0.03
            size = (theirs.box.length_m, theirs.box.width_m, theirs.box.height_m)
            assert size == (ours.box.length_m, ours.box.width_m, ours.box.height_m)


def test_a_second_run_keeps_what_is_there_and_refuses_other_settings(tmp_path: Path) -> None:
    job = Synth(tmp_path, frames=1, width_px=160, world="room")
    assert run(job).result.passed_now == 1
    assert run(job).result.passed_now == 0
    with pytest.raises(OutputSettings):
        run(Synth(tmp_path, frames=1, width_px=160, world="room", seed=1))
