"""A network that really looks: it finds what is red, and only when it is fed and cut up right."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from pseudolidar.errors import ModelError, ModelOutput
from pseudolidar.formats.onnx.model import read_onnx
from pseudolidar.formats.onnx.session import NetworkSession
from pseudolidar.obstacles.networks.class_names import class_names, listed_names
from pseudolidar.obstacles.networks.crops import crops
from pseudolidar.obstacles.networks.layout import DetectorLayout
from pseudolidar.obstacles.networks.nms import best_boxes
from pseudolidar.obstacles.networks.recognise import found_out
from pseudolidar.obstacles.onnx_detector import NetworkDetector, OnnxDetector
from pseudolidar.structures.image_size import ImageSize
from tests.obstacles import detector_graphs as graphs

WIDE, HIGH = 96, 64  # of its input
TILES = ImageSize(WIDE, HIGH)


def red_finder(path: Path, *, batch: int | str = 1, metadata: dict[str, str] | None = None) -> Path:
    """One row a picture: the box around all pixels whose first colour is above one half."""
    nodes, weights = [], []

    def const(values, dtype=np.float32):
        name = f"c{len(weights)}"
        weights.append(numpy_helper.from_array(np.asarray(values, dtype), name))
        return name

    def op(kind, *inputs, **attributes):
        name = f"t{len(nodes)}"
        nodes.append(helper.make_node(kind, list(inputs), [name], **attributes))
        return name

    def number(name):
        return op("Reshape", op("Cast", name, to=TensorProto.FLOAT), const([-1, 1], np.int64))

    red = op("Gather", "images", const(0, np.int64), axis=1)
    seen = op("Cast", op("Greater", red, const(0.5)), to=TensorProto.FLOAT)
    columns = op("ReduceMax", seen, axes=[1], keepdims=0)
    rows = op("ReduceMax", seen, axes=[2], keepdims=0)
    ends = [
        number(op("ArgMax", one, axis=1, keepdims=0, select_last_index=last))
        for last in (0, 1)
        for one in (columns, rows)
    ]
    ends[2:] = [op("Add", end, const(1.0)) for end in ends[2:]]
    score = op("Mul", number(op("ReduceMax", seen, axes=[1, 2], keepdims=0)), const(0.9))
    label = op("Mul", score, const(0.0))
    table = op("Concat", *ends, score, label, axis=1)
    nodes.append(helper.make_node("Unsqueeze", [table, const([1], np.int64)], ["found"]))
    inputs = [
        helper.make_tensor_value_info("images", TensorProto.FLOAT, [batch, 3, HIGH, WIDE]),
    ]
    outputs = [helper.make_tensor_value_info("found", TensorProto.FLOAT, [batch, 1, 6])]
    graph = helper.make_graph(nodes, "red", inputs, outputs, weights)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    helper.set_model_props(model, metadata or {})
    onnx.save(model, str(path))
    return path


def loaded(path: Path, known: DetectorLayout | None = None, **settings) -> NetworkDetector:
    model, chosen = read_onnx(path), OnnxDetector(path, **settings)
    layout = found_out(NetworkSession(model), known or DetectorLayout(), TILES)
    return NetworkDetector(chosen, model, layout, class_names(model, layout, chosen.names))


def street(left: int, top: int, right: int, bottom: int) -> np.ndarray:
    """(64, 300, 3) RGB, dark, red between two columns and rows; the ends are not part of it."""
    picture = np.full((64, 300, 3), 20, np.uint8)
    picture[top:bottom, left:right, 0] = 255
    return picture


@pytest.mark.parametrize("batch", [1, 3, "n"])
def test_tiles_find_what_is_too_small_for_the_whole(tmp_path, batch):
    path = red_finder(tmp_path / "a.onnx", batch=batch)
    picture = street(199, 30, 201, 32)  # between the samples of the whole
    assert loaded(path).detect(picture) == ()
    detector = loaded(path, tiles=TILES)
    assert detector.layout.batch == (batch if batch != "n" else 0)
    (found,) = detector.detect(picture)
    assert found.box_px == (198.5, 29.5, 200.5, 31.5)


def test_what_tiles_cut_is_found_whole_and_once(tmp_path):
    (found,) = loaded(red_finder(tmp_path / "a.onnx"), tiles=TILES).detect(street(60, 20, 240, 50))
    # The whole picture is seen at 96 / 300, so that a pixel there is three here.
    assert found.box_px == pytest.approx((59.5, 19.5, 239.5, 49.5), abs=3.2)


def test_boxes_that_end_at_a_cut_are_told_from_those_at_the_border():
    whole, *tiles = crops((64, 300), TILES)
    assert [(c.left, c.width) for c in tiles] == [(0, 96), (72, 96), (144, 96), (204, 96)]
    boxes = np.array([[0.0, 5, 40, 63], [40, 5, 95, 63], [72, 5, 120, 63], [204, 5, 299, 63]])
    assert not whole.cuts(boxes, (64, 300)).any()
    assert tiles[0].cuts(boxes[:2], (64, 300)).tolist() == [False, True]
    assert tiles[1].cuts(boxes[2:3], (64, 300)).tolist() == [True]
    assert tiles[3].cuts(boxes[3:], (64, 300)).tolist() == [True]
    low = crops((128, 96), TILES)[1]
    assert low.cuts(np.array([[5.0, 5, 40, 63], [5, 5, 40, 50]]), (128, 96)).tolist() == [
        True,
        False,
    ]


def test_objects_at_the_border_end_in_the_picture(tmp_path):
    found = loaded(red_finder(tmp_path / "a.onnx"), tiles=TILES).detect(street(290, 54, 300, 64))
    assert found[0].box_px == (289.5, 53.5, 299.0, 63.0)


def test_colours_are_fed_in_their_order(tmp_path):
    path = red_finder(tmp_path / "a.onnx")
    picture = street(60, 20, 240, 50)
    assert len(loaded(path).detect(picture)) == 1
    assert loaded(path, DetectorLayout(channels="bgr")).detect(picture) == ()
    # Unit values of 255 are at most one; raw ones of 20 are above one half everywhere.
    everywhere = loaded(path, DetectorLayout(normalisation="raw")).detect(picture)
    assert everywhere[0].box_px == (0.0, 0.0, 299.0, 63.0)


def test_boxes_inside_those_of_another_part_are_the_same_object():
    boxes = np.array([[0.0, 0, 100, 100], [10, 10, 60, 60], [300, 0, 320, 20]])
    scores, labels = np.array([0.9, 0.8, 0.7]), np.zeros(3, np.int64)
    ask = {"overlap": 0.5, "inside": 0.8}
    other = best_boxes(boxes, scores, labels, parts=np.array([0, 1, 1]), **ask)
    same = best_boxes(boxes, scores, labels, parts=np.array([0, 0, 1]), **ask)
    assert other.tolist() == [0, 2]
    assert same.tolist() == [0, 1, 2]
    unlike = best_boxes(boxes, scores, np.array([0, 1, 0]), parts=np.array([0, 1, 1]), **ask)
    assert unlike.tolist() == [0, 1, 2]


def test_the_same_box_by_two_classes_is_one_object():
    """A bicycle that the network also takes for a motorbike; a rider on it is another thing."""
    boxes = np.array([[10, 10, 50, 40], [11, 10, 51, 40], [20, 0, 40, 35.0]])
    scores, labels = np.array([0.6, 0.8, 0.7]), np.array([0, 1, 2])
    assert best_boxes(boxes, scores, labels, overlap=0.5).tolist() == [1, 2]


def test_threads_share_one_session(tmp_path):
    detector = loaded(red_finder(tmp_path / "a.onnx"), tiles=TILES)
    pictures = [street(20 + 10 * i, 10, 40 + 10 * i, 30) for i in range(16)]
    alone = [[d.box_px for d in detector.detect(picture)] for picture in pictures]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda p: [d.box_px for d in detector.detect(p)], pictures))
    assert together == alone


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.txt", "cone\npost\nbike\nbox\n"),
        ("a.names", "cone\r\npost\r\nbike\r\nbox\r\n"),
        ("a.yaml", "download: |\n  any text\nnames:\n  0: cone\n  1: post\n  2: bike\n  3: box\n"),
        ("a.json", '{"channels": "rgb", "names": ["cone", "post", "bike", "box"]}'),
        ("my_classes.txt", "cone\npost\nbike\nbox\n"),
    ],
)
def test_names_of_a_file_beside_the_network(tmp_path, name, text):
    path = graphs.written(tmp_path / "a.onnx", graphs.ultralytics())
    assert loaded(path).detect(np.zeros((200, 400, 3), np.uint8))[0].name == "class 2"
    (tmp_path / name).write_text(text)
    assert loaded(path).names[2] == "bike"


def test_lists_of_names_that_do_not_fit_are_refused(tmp_path):
    path = graphs.written(tmp_path / "a.onnx", graphs.ultralytics())
    for text, words in (("a\nb\n", "2 class names"), ("", "no class names")):
        wrong = tmp_path / "list.txt"
        wrong.write_text(text)
        with pytest.raises(ModelError, match=words):
            loaded(path, names=wrong)
    code = {"names": "{0: __import__('os').getcwd()}"}
    with pytest.raises(ModelError, match="no class names"):
        listed_names(read_onnx(graphs.written(path, graphs.yolov5(), metadata=code)), None)


def test_the_same_score_everywhere_is_named(tmp_path):
    sound = loaded(graphs.written(tmp_path / "a.onnx", graphs.ultralytics()))
    outputs = {"output0": np.full_like(graphs.ultralytics()["output0"], 0.5)}
    other = read_onnx(graphs.written(tmp_path / "b.onnx", outputs))
    with pytest.raises(ModelOutput, match=r"every score is 0\.5"):
        NetworkDetector(sound.settings, other, sound.layout, sound.names).detect(
            np.zeros((200, 400, 3), np.uint8)
        )


def test_a_file_is_tried_once_in_a_child_and_pinned_by_its_hash(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("PSEUDOLIDAR_CACHE_DIR", str(tmp_path / "cache"))
    path = red_finder(tmp_path / "a.onnx", metadata={"license": "AGPL-3.0"})
    with caplog.at_level("INFO"):
        first, second = OnnxDetector(path).load(), OnnxDetector(path).load()
    assert first.layout == second.layout
    assert ["cached" in message for message in caplog.messages] == [False, True]
    assert "licence: AGPL-3.0" in caplog.text
    digest = read_onnx(path).sha256()
    assert OnnxDetector(path, sha256=digest).load().describe()["sha256"] == digest
    with pytest.raises(ModelError, match="SHA-256"):
        OnnxDetector(path, sha256="0" * 64).load()
