"""Detectors in ONNX files: every layout is told by itself, and its boxes are where they are."""

from __future__ import annotations

import itertools
import pickle
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto

from pseudolidar.errors import MissingDependency, ModelError, ModelOutput, UsageError
from pseudolidar.formats.onnx.model import read_onnx
from pseudolidar.formats.onnx.session import NetworkSession, available_providers
from pseudolidar.obstacles.networks.class_names import class_names, listed_names
from pseudolidar.obstacles.networks.crops import crops
from pseudolidar.obstacles.networks.layout import DetectorLayout, layout_beside
from pseudolidar.obstacles.networks.recognise import found_out
from pseudolidar.obstacles.onnx_detector import NetworkDetector, OnnxDetector
from pseudolidar.structures.box import Detection
from pseudolidar.structures.image_size import ImageSize
from tests.obstacles import detector_graphs as graphs

NAMES = "\n".join(graphs.CLASSES)
PICTURE_PX = np.random.default_rng(0).integers(0, 256, (*graphs.PICTURE[::-1], 3)).astype(np.uint8)
SIZE = ImageSize(graphs.SIDE, graphs.SIDE)


def loaded(path: Path, **settings) -> NetworkDetector:
    """As `OnnxDetector.load` does, without a process of its own for the trial."""
    chosen = OnnxDetector(path, **settings)
    model = read_onnx(path)
    known = chosen.layout.filled(layout_beside(model))
    names, _ = listed_names(model, chosen.names)
    if names and known.first_label != 1:
        known = known.filled(DetectorLayout(classes=len(names)))
    layout = found_out(NetworkSession(model, flag="--detector"), known, SIZE)
    return NetworkDetector(chosen, model, layout, class_names(model, layout, chosen.names))


FAMILIES = {
    "yolox grid": ("yolox", graphs.yolox, {}),
    "yolox pixel": ("yolox", lambda: graphs.yolox(decoded=True), {}),
    "yolox 16 bit": ("yolox", graphs.yolox, {"dtype": TensorProto.FLOAT16}),
    "yolov5": ("yolov5", graphs.yolov5, {}),
    "ultralytics": ("ultralytics", graphs.ultralytics, {}),
    "end to end": ("end-to-end", graphs.end_to_end, {}),
    "end to end, shares": ("end-to-end", lambda: graphs.end_to_end(shares=True), {}),
    "seven columns": ("rows", graphs.seven_columns, {}),
    "queries": ("queries", graphs.queries, {}),
    "labels, boxes, scores": ("labels-boxes-scores", graphs.labels_boxes_scores, {}),
    "with sizes": ("labels-boxes-scores", graphs.labels_boxes_scores, {"sizes_too": True}),
    "dets, labels": ("dets-labels", graphs.dets_labels, {}),
}
MASKED = {
    "yolov5": ("yolov5", graphs.yolov5),
    "ultralytics": ("ultralytics", graphs.ultralytics),
    "end to end": ("end-to-end", graphs.end_to_end),
    "dets, labels": ("dets-labels", graphs.dets_labels),
}


def found_things(path: Path, family: str) -> tuple[Detection, ...]:
    """What a network of a family finds in the picture: the things that its graph knows."""
    path.with_suffix(".names").write_text(NAMES)
    detector = loaded(path)
    assert detector.layout.family == family
    found = detector.detect(PICTURE_PX)
    assert [one.name for one in found] == ["car", "person"]
    for one, (box, _, score) in zip(found, graphs.THINGS, strict=True):
        np.testing.assert_allclose(one.box_px, box, atol=0.01)
        assert one.score == pytest.approx(score, abs=2e-3)
    return found


@pytest.mark.parametrize("name", FAMILIES)
def test_known_boxes_come_back_through_every_layout(tmp_path: Path, name: str) -> None:
    family, outputs, how = FAMILIES[name]
    path = graphs.written(tmp_path / "a.onnx", outputs(), **how)
    assert all(one.mask is None for one in found_things(path, family))


@pytest.mark.parametrize("name", MASKED)
def test_masks_lie_where_the_network_has_them(tmp_path: Path, name: str) -> None:
    family, outputs = MASKED[name]
    path = graphs.written(tmp_path / "a.onnx", outputs(masks=True))
    for one in found_things(path, family):
        rows, columns = np.nonzero(one.mask)
        left, top, right, bottom = one.box_px
        assert columns.min() == pytest.approx(left, abs=2)
        assert columns.max() == pytest.approx((left + right) / 2, abs=4)
        assert (rows.min(), rows.max()) == pytest.approx((top, bottom), abs=2)


@pytest.mark.parametrize(
    ("outputs", "family", "how"),
    [
        (graphs.detr, "pairs", {}),
        (graphs.tf_od, "tf-od", {"nhwc": True, "dtype": TensorProto.UINT8}),
    ],
)
def test_numbers_of_coco_annotations_are_named(tmp_path: Path, outputs, family, how) -> None:
    detector = loaded(graphs.written(tmp_path / "a.onnx", outputs(), **how))
    assert detector.layout.family == family
    found = detector.detect(PICTURE_PX)
    assert [one.name for one in found] == ["car", "person"]
    for one, (box, _, _) in zip(found, graphs.THINGS, strict=True):
        np.testing.assert_allclose(one.box_px, box, atol=0.01)


def test_distributions_become_their_mean(tmp_path: Path) -> None:
    path = graphs.written(tmp_path / "a.onnx", graphs.nanodet())
    (tmp_path / "a.names").write_text(NAMES)
    detector = loaded(path)
    assert detector.layout.family == "nanodet"
    for one, box in zip(detector.detect(PICTURE_PX), graphs.nanodet_boxes(), strict=True):
        np.testing.assert_allclose(one.box_px, box, atol=0.01)


def test_names_come_from_metadata_and_classes_can_be_chosen(tmp_path: Path) -> None:
    metadata = {"names": str(dict(enumerate(graphs.CLASSES)))}
    path = graphs.written(tmp_path / "a.onnx", graphs.ultralytics(), metadata=metadata)
    detector = loaded(path, classes="car,dog")
    assert detector.names.told_by == "its metadata"
    assert [one.name for one in detector.detect(PICTURE_PX)] == ["car"]
    assert [one.name for one in loaded(path, threshold=0.85).detect(PICTURE_PX)] == ["car"]
    with pytest.raises(UsageError, match="'truck'"):
        loaded(path, classes="truck").check_classes()


def test_it_can_be_sent_to_another_process(tmp_path: Path) -> None:
    path = graphs.written(tmp_path / "a.onnx", graphs.end_to_end())
    detector = loaded(path)
    assert detector.median_ms is None
    detector.detect(PICTURE_PX)
    assert detector.median_ms > 0
    again = pickle.loads(pickle.dumps(detector))
    assert again.median_ms is None
    assert [one.box_px for one in again.detect(PICTURE_PX)] == [
        one.box_px for one in detector.detect(PICTURE_PX)
    ]
    assert detector.describe()["sha256"] == read_onnx(path).sha256()
    assert "runs on cpu" in detector.in_words()


def test_the_time_that_is_told_is_of_one_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = graphs.written(tmp_path / "a.onnx", graphs.end_to_end())
    clock_s = itertools.count()
    monkeypatch.setattr("time.perf_counter", lambda: float(next(clock_s)))
    whole, tiled = loaded(path), loaded(path, tiles=ImageSize(64, 64))
    for _ in range(3):
        whole.detect(PICTURE_PX)
        tiled.detect(PICTURE_PX)
    assert whole.median_ms == 1000
    assert tiled.median_ms == 1000 * len(crops(PICTURE_PX.shape[:2], ImageSize(64, 64)))


def test_a_provider_that_is_not_there_is_named_with_its_package(tmp_path: Path) -> None:
    path = graphs.written(tmp_path / "a.onnx", graphs.end_to_end())
    with pytest.raises(MissingDependency, match=r"no CUDAExecutionProvider") as raised:
        loaded(path, provider="cuda").session  # noqa: B018 - made when it is first used
    assert "onnxruntime-gpu" in raised.value.fix
    assert "--detector.provider cpu" in raised.value.fix
    anywhere = loaded(path, provider="auto")
    assert anywhere.describe()["provider"] == available_providers()[0]
    assert len(anywhere.detect(PICTURE_PX)) == 2


def test_a_layout_that_nobody_knows_is_shown_with_the_flags_that_describe_it(tmp_path) -> None:
    outputs = {"strange": np.random.default_rng(1).normal(0, 5, (1, 17, 3)).astype(np.float32)}
    path = graphs.written(tmp_path / "a.onnx", outputs)
    with pytest.raises(ModelError) as raised:
        loaded(path)
    assert "strange float32[1,17,3]" in raised.value.got
    assert "--detector.layout.family" in raised.value.fix
    assert raised.value.path == str(path)


def test_numbers_that_mean_nothing_are_named(tmp_path: Path) -> None:
    values = graphs.end_to_end()
    values["output0"][0, 5, 4] = np.nan
    with pytest.raises(ModelError, match="NaN on a picture of noise"):
        loaded(graphs.written(tmp_path / "nan.onnx", values))
    sound = loaded(graphs.written(tmp_path / "sound.onnx", graphs.end_to_end()))
    values = graphs.end_to_end()
    values["output0"][0, 0, :4] = 1e6
    graphs.written(tmp_path / "far.onnx", values)
    other = NetworkDetector(
        sound.settings, read_onnx(tmp_path / "far.onnx"), sound.layout, sound.names
    )
    with pytest.raises(ModelOutput):
        other.detect(PICTURE_PX)


def test_a_pickle_is_never_loaded(tmp_path: Path) -> None:
    path = tmp_path / "a.pt"
    path.write_bytes(pickle.dumps({"weights": [1, 2]}))
    with pytest.raises(ModelError, match=r"a\.pt"):
        OnnxDetector(path).load()


def test_settings_that_mean_nothing_are_refused(tmp_path: Path) -> None:
    path = graphs.written(tmp_path / "a.onnx", graphs.end_to_end())
    with pytest.raises(ModelError) as raised:
        loaded(path, names=tmp_path / "none.txt")
    assert raised.value.fix == "Check the path."
    for settings in ({"threshold": 0.0}, {"overlap": 1.5}, {"threads": 0}):
        with pytest.raises(UsageError):
            OnnxDetector(tmp_path / "a.onnx", **settings)


@pytest.mark.real
def test_a_real_network_finds_the_cars_of_a_street(real_data: Path) -> None:
    path = next((real_data / "models").rglob("yolox_nano*.onnx"))
    picture = real_data / "kitti_object" / "training" / "image_2" / "000013.png"
    import cv2

    image = cv2.cvtColor(cv2.imread(str(picture)), cv2.COLOR_BGR2RGB)
    detector = OnnxDetector(path).load()
    whole = detector.detect(image)
    assert whole[0].name == "car"
    np.testing.assert_allclose(whole[0].box_px, (975, 221, 1240, 374), atol=6)
    tiled = OnnxDetector(path, tiles=ImageSize(416, 416)).load().detect(image)
    assert sum(one.name == "car" for one in tiled) > sum(one.name == "car" for one in whole) - 1
    assert len(tiled) > len(whole)
    assert onnx.load(str(path)).graph.input[0].name == "images"
