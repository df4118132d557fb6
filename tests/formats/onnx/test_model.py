"""Network files: their signature is read without running them; unsafe ones are refused."""

from __future__ import annotations

import os
import pickle
from pathlib import Path

import numpy as np
import onnx
import pytest

from pseudolidar.errors import ModelError
from pseudolidar.formats.onnx.model import read_onnx
from tests.stereo import graphs


@pytest.fixture
def network(tmp_path: Path) -> Path:
    return graphs.two_images(
        tmp_path / "n.onnx", disparities=8, metadata={"pseudolidar.sign": "positive"}
    )


def test_the_signature_is_that_of_onnx(network):
    model = read_onnx(network)
    reference = onnx.load(str(network))
    assert [i.name for i in model.inputs] == [i.name for i in reference.graph.input]
    assert model.inputs[0].shape == (1, 3, "h", "w")
    assert (model.outputs[0].dtype, model.outputs[0].shape) == ("float32", (1, 1, "oh", "ow"))
    assert model.metadata == {"pseudolidar.sign": "positive"}
    assert model.signature == (
        "left float32[1,3,h,w]; right float32[1,3,h,w] -> disparity float32[1,1,oh,ow]"
    )


def external(network: Path, location: str, *, place: str = "graph") -> bytes:
    """The network with weights stored in another file: of the graph, a node, a graph in a node."""
    model = onnx.load(str(network))
    tensor = max(model.graph.initializer, key=lambda t: len(t.raw_data))
    data = tensor.raw_data
    onnx.external_data_helper.set_external_data(tensor, location, 0, len(data))
    tensor.ClearField("raw_data")
    tensor.data_location = onnx.TensorProto.EXTERNAL
    if place != "graph":
        node = onnx.helper.make_node("Constant", [], ["hidden"], value=tensor)
        model.graph.initializer.remove(tensor)
        if place == "branch":
            out = onnx.helper.make_tensor_value_info("hidden", 1, None)
            branch = onnx.helper.make_graph([node], "branch", [], [out])
            branches = {"then_branch": branch, "else_branch": branch}
            node = onnx.helper.make_node("If", ["which"], ["chosen"], **branches)
        model.graph.node.insert(0, node)
    network.write_bytes(model.SerializeToString())
    return data


def test_weights_beside_it_are_found_and_count(network):
    data = external(network, "weights.bin")
    with pytest.raises(ModelError, match=r"'weights\.bin' are absent"):
        read_onnx(network)
    weights = network.with_name("weights.bin")
    weights.write_bytes(data)
    before = read_onnx(network)
    assert before.external == (weights.resolve(),)
    digest = before.sha256()
    weights.write_bytes(data[:-1] + b"\x01")
    assert read_onnx(network).sha256() != digest


@pytest.mark.parametrize("place", ["graph", "node", "branch"])
@pytest.mark.parametrize("location", ["../weights.bin", "/etc/passwd", "a/../../weights.bin"])
def test_weights_outside_its_folder_are_refused(network, location, place):
    external(network, location, place=place)
    with pytest.raises(ModelError, match="outside its folder"):
        read_onnx(network)


def test_weights_that_are_links_are_refused(network, tmp_path):
    data = external(network, "weights.bin")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "real.bin").write_bytes(data)
    place = network.with_name("weights.bin")
    place.symlink_to(elsewhere / "real.bin")
    with pytest.raises(ModelError, match="outside its folder"):
        read_onnx(network)
    place.unlink()
    (network.parent / "beside.bin").write_bytes(data)
    place.symlink_to("beside.bin")  # even inside the folder
    with pytest.raises(ModelError, match="outside its folder"):
        read_onnx(network)
    place.unlink()
    os.link(elsewhere / "real.bin", place)
    with pytest.raises(ModelError, match="hard link"):
        read_onnx(network)


@pytest.mark.parametrize("name", ["n.pt", "n.pth", "n.pkl", "n.joblib", "n.onnx"])
def test_pickles_are_refused_by_name_and_by_content(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(pickle.dumps({"weights": np.zeros(3)}))
    with pytest.raises(ModelError, match="never loaded"):
        read_onnx(path)


def test_other_formats_are_named(tmp_path):
    path = tmp_path / "n.engine"
    path.write_bytes(b"engine")
    with pytest.raises(ModelError, match=r"a \.engine file.*Export it to ONNX"):
        read_onnx(path)


def test_what_is_no_network_is_refused(network, tmp_path):
    whole = network.read_bytes()
    rng = np.random.default_rng(0)
    contents = [b"", b"\x00" * 100, b"hello", rng.bytes(5000), whole[: len(whole) // 2], whole[:-1]]
    for i, content in enumerate(contents):
        path = tmp_path / f"{i}.onnx"
        path.write_bytes(content)
        with pytest.raises(ModelError):
            read_onnx(path)
    with pytest.raises(ModelError, match="No such file"):
        read_onnx(tmp_path / "absent.onnx")


def test_no_damage_escapes_the_reader(network, tmp_path):
    whole = bytearray(network.read_bytes())
    rng = np.random.default_rng(1)
    path = tmp_path / "m.onnx"
    refused = 0
    for _ in range(1000):
        damaged = bytearray(whole)
        for at in rng.integers(0, len(whole), rng.integers(1, 6)):
            damaged[at] = rng.integers(0, 256)
        path.write_bytes(damaged)
        try:
            read_onnx(path)
        except ModelError:
            refused += 1
    assert 0 < refused < 1000
