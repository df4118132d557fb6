"""A network as the matcher of `convert` and `evaluate`, through the command line."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.pictures.disparity_png import read_disparity_png
from tests.pipelines.conftest import DISPARITY_PX
from tests.stereo import graphs

LAYOUT = (
    *("--matcher.layout.normalisation", "imagenet", "--matcher.layout.channels", "rgb"),
    *("--matcher.layout.sign", "positive", "--matcher.layout.unit", "pixel"),
    *("--matcher.layout.scale", "1", "--matcher.layout.inputs", "left,right"),
    *("--matcher.layout.output", "disparity"),
)


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    return graphs.two_images(tmp_path_factory.mktemp("network") / "net.onnx", disparities=16)


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("PSEUDOLIDAR_CACHE_DIR", str(tmp_path / "cache"))


def run(capsys, *args):
    code = main([*map(str, args), "--json"])
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return code, json.loads(captured.out), captured.err


def test_convert_with_a_network_finds_the_known_disparity(drive, network, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = (drive, out, "--matcher", f"onnx:{network}", "--to", "pcd,disparity,mcap", *LAYOUT)
    code, report, _log = run(capsys, "convert", *arguments)
    assert (code, report["committed"]) == (0, 14)
    found = read_disparity_png(out / "disparity" / "000003.png").values
    assert np.nanmedian(np.abs(found - DISPARITY_PX)) < 0.1
    assert "sigma_m_median" in report["figures"]
    # The recording and the journal know the network by its content, not by its place.
    recorded = next(out.glob("*.mcap")).read_bytes()
    assert b"net.onnx" not in recorded
    assert b"sha256:" in recorded


def test_workers_leave_no_trace_and_another_network_is_another_run(
    drive, network, tmp_path, capsys
):
    def convert(out, path, *more):
        common = ("--matcher", f"onnx:{path}", "--to", "pcd,npz", "--frames", "0:6", *LAYOUT)
        return run(capsys, "convert", drive, tmp_path / out, *common, *more)

    assert convert("one", network, "--workers", "1")[0] == 0
    assert convert("three", network, "--workers", "3")[0] == 0
    for path in sorted((tmp_path / "one" / "npz").glob("*.npz")):
        assert path.read_bytes() == (tmp_path / "three" / "npz" / path.name).read_bytes()
    moved = tmp_path / "moved.onnx"
    moved.write_bytes(network.read_bytes())
    assert convert("one", moved)[0] == 0  # complete already, wherever the file lies
    other = graphs.two_images(tmp_path / "other.onnx", disparities=24)
    code, report, _log = convert("one", other)
    assert (code, report["error"]["code"]) == (2, "OutputSettings")


def test_an_answer_that_means_nothing_costs_its_frames(drive, tmp_path, capsys):
    path = graphs.answering(tmp_path / "net.onnx", "nan")
    out = tmp_path / "out"
    code, report, _log = run(
        capsys, "convert", drive, out, "--matcher", f"onnx:{path}", *LAYOUT, "--frames", "0:3"
    )
    assert code != 0
    skipped = json.loads((out / "report.json").read_text())["skipped"]
    assert {skip["code"] for skip in skipped} == {"ModelOutput"}
    assert "error" in report or report["skipped"] == 3


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [("net.pt", b"\x80\x04", "never loaded"), ("net.onnx", b"garbage", "not an ONNX network")],
)
def test_a_file_that_is_no_network_ends_with_3(drive, tmp_path, capsys, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    code, report, _log = run(
        capsys, "convert", drive, tmp_path / "out", "--matcher", f"onnx:{path}"
    )
    assert (code, report["error"]["code"]) == (3, "ModelError")
    assert message in report["error"]["got"]
    assert not (tmp_path / "out").exists()


def test_a_network_is_judged_as_any_matcher(tmp_path, capsys):
    path = graphs.two_images(tmp_path / "net.onnx", disparities=64, step=2.0, window=7)
    source = ("synthetic:street", "--source.width-px", "320", "--source.frames", "2")
    code, report, log = run(
        capsys, "evaluate", "disparity", *source, "--matcher", f"onnx:{path}", *LAYOUT
    )
    assert code == 0
    assert "told by flags" in log
    assert report["density"] > 0.3


@pytest.mark.real
def test_a_real_street_is_matched(real_data, tmp_path, capsys):
    path = graphs.two_images(tmp_path / "net.onnx", disparities=96, step=2.0, window=13)
    source = real_data / "kitti_stereo2015" / "training"
    code, report, _log = run(
        *(capsys, "evaluate", "disparity", source, "--frames", "0:1"),
        *("--matcher", f"onnx:{path}", "--matcher.consistency", *LAYOUT),
    )
    assert code == 0
    # A plain block matcher that both eyes agree on: sparse, and mostly right.
    assert report["d1_est"] < 0.2
    assert report["density"] > 0.2
