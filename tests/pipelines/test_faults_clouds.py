"""Bad files of clouds, through the command line."""

import json
import subprocess
import sys

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.points.npz import encode_npz
from pseudolidar.formats.points.pcd import encode_pcd, read_pcd
from pseudolidar.formats.points.ply import encode_ply, read_ply
from pseudolidar.formats.points.velodyne_bin import encode_velodyne_bin
from pseudolidar.structures.cloud import PointCloud

POINTS, FRAMES = 100, 6
ENCODERS = {
    "pcd": encode_pcd,
    "pcd:ascii": lambda cloud: encode_pcd(cloud, encoding="ascii"),
    "pcd:compressed": lambda cloud: encode_pcd(cloud, encoding="binary_compressed"),
    "ply": encode_ply,
    "ply:ascii": lambda cloud: encode_ply(cloud, encoding="ascii"),
    "bin": encode_velodyne_bin,
    "npz": encode_npz,
}
TYPED = ["PointFileTruncated", "PointFileHeader", "PointFileCorrupt", "PointFileField"]


def cloud_of(seed, **columns):
    xyz = np.random.default_rng(seed).uniform(1, 40, (POINTS, 3)).astype(np.float32)
    return PointCloud(xyz, "velodyne", intensity=np.full(POINTS, 0.5, np.float32), **columns)


@pytest.fixture
def clouds(tmp_path):
    """Writes a folder of six clouds of a kind; returns it."""

    def write(kind):
        folder = tmp_path / "clouds"
        folder.mkdir()
        for index in range(FRAMES):
            path = folder / f"{index:06d}.{kind.partition(':')[0]}"
            path.write_bytes(ENCODERS[kind](cloud_of(index)))
        return folder

    return write


def converted(capsys, source, out, *options):
    """Exit code and skipped frames of a conversion, with their errors; no traceback."""
    code = main(["convert", str(source), str(out), *options])
    assert "Traceback" not in capsys.readouterr().err
    report = json.loads((out / "report.json").read_text())
    return code, {skip["id"]: skip for skip in report["skipped"]}, report


def victim(folder):
    return sorted(folder.iterdir())[2]


@pytest.mark.parametrize("kind", ENCODERS)
def test_a_cut_file_costs_its_frame(clouds, tmp_path, capsys, kind):
    folder = clouds(kind)
    path = victim(folder)
    path.write_bytes(path.read_bytes()[:-7])
    code, skipped, _ = converted(capsys, folder, tmp_path / "out", "--to", "npz")
    assert code == 4
    assert list(skipped) == ["000002"]
    assert skipped["000002"]["code"] == "PointFileTruncated"
    assert skipped["000002"]["path"] == str(path)
    assert not (tmp_path / "out" / "npz" / "000002.npz").exists()


@pytest.mark.parametrize("kind", ENCODERS)
@pytest.mark.parametrize("left", [1000, 60, 5, 0])
def test_a_cut_file_alone_is_the_error_wherever_it_is_cut(clouds, tmp_path, capsys, kind, left):
    """Also where the header is cut, and of archives their directory."""
    if (kind, left) in (("bin", 1000), ("bin", 60), ("bin", 0)):
        left = 7  # 0 is a scan without points, 1000 is found implausible
    path = victim(clouds(kind))
    path.write_bytes(path.read_bytes()[:left])
    code = main(["convert", str(path), str(tmp_path / "out"), "--to", "npz", "--json"])
    error = json.loads(capsys.readouterr().out)["error"]
    assert (code, error["code"], error["path"]) == (3, "PointFileTruncated", str(path))
    assert all(error[part] for part in ("where", "got", "want", "fix"))
    assert not list((tmp_path / "out").rglob("*.npz"))


@pytest.mark.parametrize("kind", ["pcd", "pcd:ascii", "ply", "ply:ascii", "bin"])
@pytest.mark.parametrize("cut", [1, 7, 50])
def test_salvaged_are_whole_points_and_that_is_told(clouds, tmp_path, capsys, kind, cut):
    folder = clouds(kind)
    path = victim(folder)
    path.write_bytes(path.read_bytes()[:-cut])
    code, skipped, report = converted(capsys, folder, tmp_path / "out", "--salvage")
    assert (code, skipped) == (0, {})
    (notes,) = (frame["notes"] for frame in report["per_frame"] if "notes" in frame)
    saved = read_pcd(tmp_path / "out" / "pcd" / "000002.pcd")
    assert POINTS - 5 < len(saved) < POINTS
    assert (f"salvaged: {len(saved)} of {POINTS} points" in notes) or kind == "bin"
    assert "salvaged" in notes[0]
    np.testing.assert_array_equal(saved.xyz, cloud_of(2).xyz[: len(saved)])


def test_compressed_points_cannot_be_salvaged(clouds, tmp_path, capsys):
    folder = clouds("pcd:compressed")
    path = victim(folder)
    path.write_bytes(path.read_bytes()[:-7])
    _, skipped, _ = converted(capsys, folder, tmp_path / "out", "--salvage")
    assert skipped["000002"]["code"] == "PointFileTruncated"


@pytest.mark.parametrize(("kind", "name"), [("ply", "pcd"), ("pcd", "ply"), ("npz", "pcd"),
                                            ("ply", "bin"), ("pcd", "bin")])  # fmt: skip
def test_another_content_than_the_extension(clouds, tmp_path, capsys, kind, name):
    folder = clouds("npz")
    path = victim(folder)
    path.unlink()
    path = path.with_suffix(f".{name}")
    path.write_bytes(ENCODERS[kind](cloud_of(2)))
    code, skipped, _ = converted(capsys, folder, tmp_path / "out")
    assert (code, list(skipped)) == (4, ["000002"])
    told = " ".join(map(str, skipped["000002"].values()))
    content = {"ply": "PLY cloud", "pcd": "PCD cloud", "npz": "ZIP archive"}[kind]
    assert content in told
    assert "--sniff" in told
    code, skipped, report = converted(capsys, folder, tmp_path / "sniffed", "--sniff")
    assert (code, skipped) == (0, {})
    saved = read_pcd(tmp_path / "sniffed" / "pcd" / "000002.pcd")
    np.testing.assert_array_equal(saved.xyz, cloud_of(2).xyz)
    assert f"read as {kind.upper()}" in str(report["per_frame"][2]["notes"])


def test_records_of_20_bytes_are_asked_for(clouds, tmp_path, capsys):
    folder = clouds("bin")
    for path in folder.iterdir():
        values = np.fromfile(path, "<f4").reshape(-1, 4)[:99]
        np.hstack([values, np.zeros((99, 1), np.float32)]).astype("<f4").tofile(path)
    code = main(["convert", str(folder), str(tmp_path / "out"), "--to", "npz"])
    assert code == 3
    assert "--record-size 20" in capsys.readouterr().err
    code, skipped, report = converted(
        capsys, folder, tmp_path / "out", "--to", "npz", "--record-size", "20"
    )
    assert (code, skipped) == (0, {})
    assert report["figures"]["points"]["min"] == 99


def test_implausible_and_empty_scans(clouds, tmp_path, capsys):
    folder = clouds("bin")
    for number, share in ((1, 0.05), (2, 0.5)):
        path = sorted(folder.iterdir())[number]
        values = np.fromfile(path, "<f4").reshape(-1, 4)
        values[: int(len(values) * share), 0] = np.nan
        values.tofile(path)
    sorted(folder.iterdir())[3].write_bytes(b"")
    code, skipped, report = converted(capsys, folder, tmp_path / "out", "--to", "npz")
    assert code == 4
    assert {name: skip["code"] for name, skip in skipped.items()} == {"000002": "PointFileCorrupt"}
    assert "Is it a Velodyne file" in skipped["000002"]["fix"]
    notes = {frame["id"]: frame.get("notes") for frame in report["per_frame"]}
    assert notes["000001"] == ["5 implausible points left out"]
    assert notes["000003"] == ["empty"]
    assert notes["000004"] is None


HEADER = (
    "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    "WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n"
)


@pytest.mark.parametrize(
    ("old", "new", "code", "said"),
    [
        ("SIZE 4 4 4", "SIZE 4 4 3", "PointFileHeader", "line 3"),
        ("SIZE 4 4 4", "SIZE 4 4 -4", "PointFileHeader", "line 3"),
        ("TYPE F F F", "TYPE F F X", "PointFileHeader", "F, I or U"),
        ("COUNT 1 1 1", "COUNT 1 1", "PointFileHeader", "line 5"),
        ("WIDTH 2", "WIDTH 3", "PointFileHeader", "WIDTH x HEIGHT = 3"),
        ("DATA ascii", "DATA bogus", "PointFileHeader", "ascii or binary"),
        ("FIELDS x y z", "FIELDS x y i", "PointFileField", "i"),
        ("WIDTH 2", "WIDTH 1000000000000", "PointFileHeader", "WIDTH"),
        ("WIDTH 2\nHEIGHT 1\nPOINTS 2", "WIDTH 1000000000000\nHEIGHT 1\nPOINTS 1000000000000",
         "PointFileTruncated", "enough for"),
    ],
)  # fmt: skip
def test_illegal_headers_are_told_by_line(clouds, tmp_path, capsys, old, new, code, said):
    folder = clouds("pcd:ascii")
    victim(folder).write_text(HEADER.replace(old, new) + "1 2 3\n4 5 6\n")
    ended, skipped, _ = converted(capsys, folder, tmp_path / "out")
    assert ended == 4
    assert skipped["000002"]["code"] == code
    assert said in " ".join(map(str, skipped["000002"].values()))


def test_a_mesh_with_a_wrong_face_costs_its_frame(clouds, tmp_path, capsys):
    folder = clouds("ply")
    path = victim(folder)
    listed = b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    body = path.read_bytes().replace(b"end_header\n", listed)
    path.write_bytes(body + b"\x03" + np.array([0, 1, 999_999], "<i4").tobytes())
    code, skipped, _ = converted(capsys, folder, tmp_path / "out")
    assert code == 4
    assert (skipped["000002"]["code"], skipped["000002"]["where"]) == ("MeshIndex", "face 0")


CLAIMS = """
import resource, sys, time
from pathlib import Path
from pseudolidar.errors import PointFileTruncated
from pseudolidar.formats.points.cloud_file import read_cloud
import pseudolidar.formats.points.lzf

path = Path(sys.argv[1])
before_kb, begin_s = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
try:
    read_cloud(path)
except PointFileTruncated:
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
    print(time.process_time() - begin_s, grown / 1e3)
"""


@pytest.mark.parametrize("body", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("suffix", ["pcd", "ply"])
def test_claims_of_a_trillion_points_cost_nothing(tmp_path, suffix, body):
    if (suffix, body) == ("ply", "binary_compressed"):
        body = "binary_big_endian"
    n = 10**12
    path = tmp_path / f"a.{suffix}"
    properties = "".join(f"property float {axis}\n" for axis in "xyz")
    kind = "binary_little_endian" if body == "binary" else body
    ply = f"ply\nformat {kind} 1.0\nelement vertex {n}\n{properties}end_header\n"
    pcd = HEADER.replace("WIDTH 2", f"WIDTH {n}").replace("POINTS 2", f"POINTS {n}")
    header = ply if suffix == "ply" else pcd.replace("ascii", body)
    path.write_bytes(header.encode() + b"1 2 3\n4 5 6\n" * 20)
    ended = subprocess.run(
        [sys.executable, "-c", CLAIMS, str(path)], capture_output=True, text=True, check=True
    )
    seconds, megabytes = map(float, ended.stdout.split())
    assert seconds < 10  # 5 ms; to make room for them takes minutes
    assert megabytes < 50


def test_unusual_but_legal_files_become_the_same_points(tmp_path, capsys):
    folder = tmp_path / "odd"
    folder.mkdir()
    xyz = cloud_of(0).xyz
    record = np.dtype([("pad", "<f4"), ("hist", "<u2", 3), ("xyz", "<f8", 3)])
    rows = np.zeros(POINTS, record)
    rows["xyz"] = xyz
    pcd = (
        "VERSION .7\nFIELDS _ h x y z\nSIZE 4 2 8 8 8\nTYPE f u f f f\nCOUNT 1 3 1 1 1\n"
        f"WIDTH {POINTS}\nHEIGHT 1\nPOINTS {POINTS}\nDATA binary\n"
    )
    (folder / "0.pcd").write_bytes(pcd.encode() + rows.tobytes())
    ply = (
        f"ply\r\nformat binary_big_endian 1.0\r\nelement vertex {POINTS}\r\n"
        "property list uchar int w\r\nproperty double x\r\nproperty double y\r\n"
        "property double z\r\nend_header\r\n"
    )
    body = b"".join(b"\x01" + bytes(4) + point.astype(">f8").tobytes() for point in xyz)
    (folder / "1.ply").write_bytes(ply.encode() + body)
    code, skipped, _ = converted(capsys, folder, tmp_path / "out", "--to", "ply")
    assert (code, skipped) == (0, {})
    for name in ("0", "1"):
        cloud = read_ply(tmp_path / "out" / "ply" / f"{name}.ply")
        np.testing.assert_array_equal(cloud.xyz.astype(np.float32), xyz)
