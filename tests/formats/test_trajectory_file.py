"""Files of poses by content: what is written is read again, and what is wrong is named by line."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import PoseFileError, SequenceTime
from pseudolidar.formats.euroc_poses import write_euroc_trajectory
from pseudolidar.formats.timestamps import write_times
from pseudolidar.formats.trajectory import write_kitti_poses
from pseudolidar.formats.trajectory_file import read_trajectory, trajectory_form
from pseudolidar.formats.tum import write_tum_trajectory

TIMES_NS = (1_403_636_579_763_555_585, 1_403_636_579_768_555_584, 1_403_636_580_000_000_001)
TUM_ROW = "1.5 1 2 3 0 0 0 1"
EUROC_ROW = "1500000000,1,2,3,1,0,0,0"


@pytest.fixture
def poses() -> np.ndarray:
    rng = np.random.default_rng(7)
    rotations = np.linalg.qr(rng.normal(size=(3, 3, 3)))[0]
    rotations *= np.sign(np.linalg.det(rotations))[:, None, None]
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = rotations, rng.normal(size=(3, 3)) * 1000
    return matrices


@pytest.mark.parametrize(
    ("form", "write"), [("TUM", write_tum_trajectory), ("EuRoC", write_euroc_trajectory)]
)
def test_what_is_written_is_read_again_whatever_it_is_called(tmp_path, poses, form, write):
    write(tmp_path / "a.bin", TIMES_NS, poses)
    found = read_trajectory(tmp_path / "a.bin")
    assert (found.form, tuple(found.times_ns)) == (form, TIMES_NS)
    np.testing.assert_array_equal(found.T_world_body[:, :3, 3], poses[:, :3, 3])
    np.testing.assert_allclose(found.T_world_body, poses, atol=1e-15 * 1000)


@pytest.mark.parametrize("beside", ["00_times.txt", "times.txt", "../sequences/00/times.txt"])
def test_kitti_poses_take_the_times_that_lie_with_them(tmp_path, poses, beside):
    path = tmp_path / "poses" / "00.txt"
    (path.parent / beside).parent.mkdir(parents=True, exist_ok=True)
    path.parent.mkdir(exist_ok=True)
    write_kitti_poses(path, poses)
    assert read_trajectory(path).times_ns is None
    place = (path.parent / beside).resolve()
    place.parent.mkdir(parents=True, exist_ok=True)
    write_times(place, [0, 10**8, 2 * 10**8])
    found = read_trajectory(path)
    assert (found.form, list(found.times_ns)) == ("KITTI", [0, 10**8, 2 * 10**8])
    np.testing.assert_array_equal(found.T_world_body, poses)


def test_times_beside_that_do_not_fit_are_told_and_those_asked_for_refused(tmp_path, poses):
    write_kitti_poses(tmp_path / "00.txt", poses)
    write_times(tmp_path / "times.txt", [0, 10**8])
    found = read_trajectory(tmp_path / "00.txt")
    assert found.times_ns is None
    assert "3 poses and 2 times" in found.notes[0]
    with pytest.raises(PoseFileError) as caught:
        read_trajectory(tmp_path / "00.txt", times=tmp_path / "times.txt")
    assert (caught.value.where, caught.value.got) == ("pose 3", "3 poses and 2 times of times.txt")


@pytest.mark.parametrize(
    ("text", "form"),
    [
        (f"# a comment\n\n{TUM_ROW}\n", "TUM"),
        (f"\ufeff{TUM_ROW}\r\n", "TUM"),
        (f"#timestamp [ns],x,y,z,w,x,y,z\n{EUROC_ROW},0,0,0,0,0,0,0,0,0\n", "EuRoC"),
        (f"timestamp,x,y,z,qw,qx,qy,qz\n{EUROC_ROW}\n", "EuRoC"),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n", "KITTI"),
        ("Car 0.00 0 -1.58 587.01 173.33 614.12\n", None),
        ("# nothing else\n", None),
        ("1 0 0 0 1 0 0 0 1\n", None),
    ],
)
def test_forms_are_told_by_content(tmp_path, text, form):
    path = tmp_path / "a.txt"
    path.write_text(text, encoding="utf-8")
    assert trajectory_form(path) == form
    if form is None:
        with pytest.raises(PoseFileError, match="TUM"):
            read_trajectory(path)
    else:
        assert len(read_trajectory(path)) == 1


@pytest.mark.parametrize(
    ("text", "error", "where", "got"),
    [
        (f"{TUM_ROW}\n2.5 1 2 nan 0 0 0 1", PoseFileError, "line 2, column 9", "'nan'"),
        (f"{TUM_ROW}\n2.5 1 2 3 0 0 0", PoseFileError, "line 2", "7 numbers"),
        (f"{TUM_ROW}\n2.5 1 2 3 1 0 0 1", PoseFileError, "line 2", "length 1.414"),
        ("1403636579763555584 1 2 3 0 0 0 1", PoseFileError, "line 1, column 1", "1403636"),
        (f"{TUM_ROW}\n2.5 1 1e300 3 0 0 0 1", PoseFileError, "line 2", "at 1, 1e+300, 3 m"),
        ("1 0 0 -1e9 0 1 0 0 0 0 1 0", PoseFileError, "line 1", "at -1e+09, 0, 0 m"),
        (f"{EUROC_ROW}\n15.5,1,2,3,1,0,0,0", PoseFileError, "line 2, column 1", "'15.5'"),
        (f"{EUROC_ROW}\n2500000000,1,x,3,1,0,0,0", PoseFileError, "line 2, column 14", "'x'"),
        (f"{EUROC_ROW}\n2500000000,1,2,3,1,0,0", PoseFileError, "line 2", "7 columns"),
        (
            f"# c\n{TUM_ROW}\n1.5 1 2 3 0 0 0 1",
            SequenceTime,
            "line 3",
            "is that of the one",
        ),
        (f"{TUM_ROW}\n2 1 2 3 0 0 0 1\n1 1 2 3 0 0 0 1", SequenceTime, "line 3", "pose 2"),
        (f"#h\n{EUROC_ROW}\n15,1,2,3,1,0,0,0", SequenceTime, "line 3", "1.49999999 s before"),
    ],
)
def test_what_is_wrong_is_named_by_its_line(tmp_path, text, error, where, got):
    (tmp_path / "a.txt").write_text(text + "\n")
    with pytest.raises(error) as caught:
        read_trajectory(tmp_path / "a.txt")
    assert caught.value.where == where
    assert got in caught.value.got


def test_a_gap_is_told(tmp_path):
    rows = [f"{t} 0 0 0 0 0 0 1" for t in (1, 1.1, 1.2, 1.3, 2.3, 2.4)]
    (tmp_path / "a.txt").write_text("\n".join(rows))
    (note,) = read_trajectory(tmp_path / "a.txt").notes
    assert "1 gap(s)" in note
    assert "the widest 1 s after pose 3" in note
