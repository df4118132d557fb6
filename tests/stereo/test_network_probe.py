"""Networks whose names say nothing: how they are fed and read is found out from their answers."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import ModelError
from pseudolidar.formats.onnx.model import read_onnx
from pseudolidar.formats.onnx.session import NetworkSession
from pseudolidar.stereo.networks.layout import NetworkLayout
from pseudolidar.stereo.networks.names import expected_layout
from pseudolidar.stereo.networks.probe import find_layout, working_pad
from pseudolidar.stereo.networks.scene import probe_scene
from tests.stereo import graphs

SIZE = (224, 96)
BLANK = {"names": ("a", "b"), "output": "c", "disparities": 20, "size": SIZE}


def found(path, **asked):
    model, known = read_onnx(path), NetworkLayout(**asked)
    session = NetworkSession(model)
    return find_layout(session, known, expected_layout(model, known), iterations=8)


@pytest.mark.parametrize("size", [(256, 128), (160, 120)])
def test_the_scene_is_what_it_says(size):
    scene = probe_scene(*size, seed=3)
    y, x = np.nonzero(scene.visible)
    d = scene.truth[y, x]
    at = x - d
    low = np.floor(at).astype(int)
    share = (at - low)[:, None]
    right = scene.right.astype(float)
    beside = np.minimum(low + 1, size[0] - 1)
    seen = right[y, low] * (1 - share) + right[y, beside] * share
    off = np.abs(seen - scene.left[y, x])[:, :2]  # blue is noise, mostly
    other = np.abs(right[y, np.maximum(low - 3, 0)] - scene.left[y, x])[:, :2]
    assert np.median(off) < 0.45 * np.median(other)
    assert 0.75 < scene.visible.mean() < 1
    assert np.ptp(scene.truth) > 0.04 * size[0]


CASES = {
    "raw": {"normalisation": "raw"},
    "unit": {"normalisation": "unit"},
    "centred": {"normalisation": "centred"},
    "imagenet": {"normalisation": "imagenet"},
    "blue first": {"normalisation": "raw", "channels": "bgr"},
    "grey": {"normalisation": "unit", "channels": "grey"},
    "negative flow after a coarse one": {"normalisation": "raw", "sign": -1, "layout": "both"},
    "sides exchanged": {"normalisation": "unit", "swapped": True},
    "sides exchanged, flow of any sign": {
        "normalisation": "raw",
        "swapped": True,
        "both_ways": True,
        "sign": -1,
    },
    "widths": {"normalisation": "unit", "width_unit": True},
    "a quarter of the size, in its pixels": {"normalisation": "unit", "coarse": 4, "scale": 0.25},
    "a quarter of the size, in full pixels": {"normalisation": "unit", "coarse": 4},
    "divided by 192": {"normalisation": "unit", "scale": 1 / 192},
    "iterations": {"normalisation": "raw", "layout": "iterations"},
    "16 bits, flow of two channels": {
        "normalisation": "raw",
        "layout": "flow",
        "dtype": "float16",
    },
    "8 bits in, three axes out": {"normalisation": "raw", "layout": "nhw", "dtype": "uint8"},
}


@pytest.mark.parametrize("case", CASES)
def test_two_images_are_found_out(tmp_path, case):
    wanted = CASES[case]
    path = graphs.two_images(tmp_path / "n.onnx", **{**BLANK, **wanted})
    finding = found(path)
    layout = finding.layout
    assert finding.found > 0.85
    assert layout.normalisation == wanted["normalisation"]
    assert layout.channels == wanted.get("channels", "rgb")
    assert layout.inputs == ("right,left" if "swapped" in wanted else "left,right")
    assert layout.sign == ("negative" if wanted.get("sign", 1) < 0 else "positive")
    assert layout.unit == ("width" if "width_unit" in wanted else "pixel")
    assert layout.scale == pytest.approx(
        1 if "width_unit" in wanted else 1 / wanted.get("scale", 1)
    )
    if wanted.get("layout") in ("both", "iterations"):
        assert (layout.output, layout.channel) in {("c_1", 0), ("c", 2)}


@pytest.mark.parametrize(
    ("arguments", "roles", "channels"),
    [
        ({"channels": "grey"}, "left+right", "grey"),
        ({"channels": "rgb", "nhwc": True}, "left+right", "rgb"),
        ({"channels": "rgb", "swapped": True}, "right+left", "rgb"),
    ],
)
def test_both_images_in_one_input_are_found_out(tmp_path, arguments, roles, channels):
    path = graphs.stacked(tmp_path / "n.onnx", name="a", output="b", size=SIZE, **arguments)
    layout = found(path).layout
    assert (layout.inputs, layout.channels, layout.normalisation) == (roles, channels, "unit")


def test_half_size_inputs_are_found_out_by_their_size(tmp_path):
    names = ("d", "c", "b", "a")
    path = graphs.coarse_to_fine(tmp_path / "n.onnx", names=names, output="e", size=SIZE)
    layout = found(path).layout
    assert layout.inputs == "half-left,half-right,left,right"
    assert (layout.normalisation, layout.channel) == ("raw", 0)


@pytest.mark.parametrize("negative", [False, True])
def test_an_initial_flow_is_found_out_with_its_sign(tmp_path, negative):
    names = ("a", "b", "c")
    path = graphs.coarse_to_fine(
        tmp_path / "n.onnx", names=names, output="e", size=SIZE, given_flow=True, negative=negative
    )
    layout = found(path).layout
    assert layout.inputs == f"left,right,{'negative-flow' if negative else 'flow'}"
    assert layout.sign == "positive"


def test_what_is_asked_for_is_not_tried_otherwise(tmp_path):
    path = graphs.two_images(tmp_path / "n.onnx", normalisation="unit", **BLANK)
    with pytest.raises(ModelError, match=r"its layout could not be told.*--matcher\.layout\."):
        found(path, normalisation="raw")
    assert found(path, normalisation="unit", channels="rgb").layout.channels == "rgb"


def test_edges_that_a_free_size_must_be_a_multiple_of(tmp_path):
    layout = NetworkLayout(inputs="left,right", normalisation="unit", channels="rgb")
    for multiple, pad in ((32, 32), (64, 64), (128, 128)):
        path = graphs.two_images(
            tmp_path / f"{multiple}.onnx", normalisation="unit", disparities=8, multiple=multiple
        )
        assert working_pad(NetworkSession(read_onnx(path)), layout, iterations=1) == pad
