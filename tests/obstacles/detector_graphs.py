"""Small detectors that see two known things in every picture, in the layout of each family."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

SIDE = 128  # of the square input
PICTURE = (400, 200)  # width and height
CLASSES = ("person", "bicycle", "car", "dog")
CAR, PERSON = (40.0, 30.0, 120.0, 90.0), (200.0, 60.0, 260.0, 150.0)
THINGS = ((CAR, 2, 0.9), (PERSON, 0, 0.8))
STRIDES = (8, 16, 32)


def in_input(box: tuple[float, ...], fit: str) -> np.ndarray:
    """(4,) left, top, right, bottom in the input; edges of pixels are at whole numbers there."""
    ratio = min(SIDE / PICTURE[0], SIDE / PICTURE[1])
    if fit == "stretch":
        scale, shift = np.array([SIDE / PICTURE[0], SIDE / PICTURE[1]]), np.zeros(2)
    else:
        scale = np.array([ratio, ratio])
        shift = np.array([0, (SIDE - round(PICTURE[1] * ratio)) // 2]) * (fit == "centre")
    edges = (np.array(box).reshape(2, 2) + 0.5) * scale + shift
    return edges.ravel()


def centred(edges: np.ndarray) -> np.ndarray:
    """Centre and size of edges."""
    return np.concatenate([(edges[:2] + edges[2:]) / 2, edges[2:] - edges[:2]])


def grid() -> np.ndarray:
    """(336, 3) column, row, stride of each cell."""
    parts = []
    for stride in STRIDES:
        n = SIDE // stride
        rows, columns = np.divmod(np.arange(n * n), n)
        parts.append(np.stack([columns, rows, np.full(n * n, stride)], axis=1))
    return np.concatenate(parts).astype(float)


def cell_of(edges: np.ndarray) -> int:
    """The cell of the finest grid that the middle of a box lies in."""
    x, y = centred(edges)[:2] // STRIDES[0]
    return int(y * (SIDE // STRIDES[0]) + x)


def one_hot(label: int, score: float) -> np.ndarray:
    return np.where(np.arange(len(CLASSES)) == label, score, 0.01 * score)


def written(
    path: Path,
    outputs: dict[str, np.ndarray],
    *,
    dtype: int = TensorProto.FLOAT,
    nhwc: bool = False,
    metadata: dict[str, str] | None = None,
    sizes_too: bool = False,
) -> Path:
    """A network that answers with these outputs, whatever it sees."""
    shape = [1, None, None, 3] if nhwc else [1, 3, SIDE, SIDE]
    inputs = [helper.make_tensor_value_info("images", dtype, shape)]
    if sizes_too:
        inputs.append(helper.make_tensor_value_info("orig_target_sizes", TensorProto.INT64, [1, 2]))
    nodes = [
        helper.make_node("Cast", ["images"], ["seen"], to=TensorProto.FLOAT),
        helper.make_node("ReduceSum", ["seen"], ["all"], keepdims=0),
        helper.make_node("Mul", ["all", "zero"], ["nothing"]),
    ]
    weights = [numpy_helper.from_array(np.array(0, np.float32), "zero")]
    told = []
    for name, values in outputs.items():
        kind = helper.np_dtype_to_tensor_dtype(values.dtype)
        weights.append(numpy_helper.from_array(np.ascontiguousarray(values), f"{name}_values"))
        nodes.append(helper.make_node("Cast", ["nothing"], [f"{name}_nothing"], to=kind))
        nodes.append(helper.make_node("Add", [f"{name}_values", f"{name}_nothing"], [name]))
        told.append(helper.make_tensor_value_info(name, kind, list(values.shape)))
    graph = helper.make_graph(nodes, "detector", inputs, told, weights)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)])
    model.ir_version = 9
    for key, value in (metadata or {}).items():
        model.metadata_props.add(key=key, value=value)
    onnx.save(model, str(path))
    return path


def yolox(*, decoded: bool = False) -> dict[str, np.ndarray]:
    cells = grid()
    rows = np.zeros((len(cells), 5 + len(CLASSES)), np.float32)
    if decoded:
        rows[:, :2] = (cells[:, :2] + 0.5) * cells[:, 2:]
        rows[:, 2:4] = 8.0
    for box, label, score in THINGS:
        edges = in_input(box, "corner")
        k, middle = cell_of(edges), centred(edges)
        raw = np.concatenate([middle[:2] / 8 - cells[k, :2], np.log(middle[2:] / 8)])
        rows[k] = [*(middle if decoded else raw), score, *one_hot(label, 1.0)]
    return {"output": rows[None]}


def half_masks(fit: str) -> np.ndarray:
    """(2, SIDE, SIDE) 1 in the left half of each thing's box, -1 elsewhere."""
    maps = np.full((2, SIDE, SIDE), -1.0, np.float32)
    for at, (box, _, _) in enumerate(THINGS):
        left, top, right, bottom = np.round(in_input(box, fit)).astype(int)
        maps[at, top:bottom, left : (left + right) // 2] = 1.0
    return maps


def coefficients(at: int, *, masks: bool) -> np.ndarray:
    """Of a thing's prototype, where there are any."""
    return np.eye(2)[at] if masks else np.zeros(0)


def prototypes(*, masks: bool) -> dict[str, np.ndarray]:
    """The output of maps, where there is one."""
    return {"output1": half_masks("centre")[None]} if masks else {}


def yolov5(*, masks: bool = False) -> dict[str, np.ndarray]:
    rows = np.zeros((3 * len(grid()), 5 + len(CLASSES) + 2 * masks), np.float32)
    for at, (box, label, score) in enumerate(THINGS):
        middle = centred(in_input(box, "centre"))
        parts = (middle, [score], one_hot(label, 1.0), coefficients(at, masks=masks))
        rows[40 * at + 3] = np.concatenate(parts)
    return {"output0": rows[None], **prototypes(masks=masks)}


def ultralytics(*, masks: bool = False) -> dict[str, np.ndarray]:
    columns = np.zeros((len(grid()), 4 + len(CLASSES) + 2 * masks), np.float32)
    for at, (box, label, score) in enumerate(THINGS):
        edges = in_input(box, "centre")
        parts = (centred(edges), one_hot(label, score), coefficients(at, masks=masks))
        columns[cell_of(edges)] = np.concatenate(parts)
    return {"output0": columns.T[None], **prototypes(masks=masks)}


def end_to_end(*, shares: bool = False, masks: bool = False) -> dict[str, np.ndarray]:
    rows = np.zeros((300, 6 + 2 * masks), np.float32)
    for at, (box, label, score) in enumerate(THINGS):
        edges = in_input(box, "centre") / (SIDE if shares else 1)
        rows[at] = [*edges, score, label, *coefficients(at, masks=masks)]
    return {"output0": rows[None], **prototypes(masks=masks)}


def seven_columns() -> dict[str, np.ndarray]:
    rows = [[0, *in_input(box, "centre"), label, score] for box, label, score in THINGS]
    return {"output": np.array(rows, np.float32)}


def detr() -> dict[str, np.ndarray]:
    """COCO's annotation numbers: 1 is a person, 3 is a car; the last of 92 is nothing."""
    logits = np.full((100, 92), -8.0, np.float32)
    logits[:, 91] = 8.0
    boxes = np.full((100, 4), 0.5, np.float32)
    for at, (box, label, score) in enumerate(THINGS):
        boxes[at] = centred(in_input(box, "stretch") / SIDE)
        odds = np.full(92, (1 - score) / 91)
        odds[{2: 3, 0: 1}[label]] = score
        logits[at] = np.log(odds)
    return {"logits": logits[None], "pred_boxes": boxes[None]}


def queries() -> dict[str, np.ndarray]:
    rows = np.full((300, 4 + len(CLASSES)), 0.01, np.float32)
    for at, (box, label, score) in enumerate(THINGS):
        rows[at] = [*centred(in_input(box, "stretch") / SIDE), *one_hot(label, score)]
    return {"output0": rows[None]}


def labels_boxes_scores() -> dict[str, np.ndarray]:
    count = 10
    boxes, scores = np.zeros((1, count, 4), np.float32), np.zeros((1, count), np.float32)
    labels = np.zeros((1, count), np.int64)
    for at, (box, label, score) in enumerate(THINGS):
        boxes[0, at], labels[0, at], scores[0, at] = in_input(box, "stretch"), label, score
    return {"labels": labels, "boxes": boxes, "scores": scores}


def dets_labels(*, masks: bool = False) -> dict[str, np.ndarray]:
    """Masks are probabilities over the whole input."""
    rows = np.zeros((1, 10, 5), np.float32)
    labels = np.full((1, 10), -1, np.int64)
    for at, (box, label, score) in enumerate(THINGS):
        rows[0, at], labels[0, at] = [*in_input(box, "corner"), score], label
    whole = np.zeros((1, 10, SIDE, SIDE), np.float32)
    whole[0, :2] = half_masks("corner") > 0
    return {"dets": rows, "labels": labels} | ({"masks": whole} if masks else {})


def tf_od() -> dict[str, np.ndarray]:
    boxes, scores = np.zeros((1, 10, 4), np.float32), np.zeros((1, 10), np.float32)
    classes = np.ones((1, 10), np.float32)
    for at, (box, label, score) in enumerate(THINGS):
        left, top, right, bottom = (np.array(box) + 0.5) / np.array([*PICTURE, *PICTURE])
        boxes[0, at], scores[0, at] = [top, left, bottom, right], score
        classes[0, at] = {2: 3, 0: 1}[label]
    return {
        "detection_boxes": boxes,
        "detection_classes": classes,
        "detection_scores": scores,
        "num_detections": np.array([2], np.float32),
    }


def nanodet() -> dict[str, np.ndarray]:
    """Distances are whole cells, so that one bin of each distribution holds them."""
    cells, bins = grid(), 8
    rows = np.zeros((len(cells), len(CLASSES) + 4 * bins), np.float32)
    rows[:, len(CLASSES) :] = -1.0
    for at, (_, label, score) in enumerate(THINGS):
        k = 16 * (6 - 2 * at) + 5 + 3 * at
        rows[k, : len(CLASSES)] = one_hot(label, score)
        distances = rows[k, len(CLASSES) :].reshape(4, bins)
        distances[np.arange(4), NANODET_CELLS[at]] = 60.0
    return {"output": rows[None]}


# Cells to the left, top, right and bottom of each of its boxes.
NANODET_CELLS = ((2, 1, 3, 2), (1, 3, 2, 4))


def nanodet_boxes() -> list[np.ndarray]:
    """The boxes of `nanodet` in the picture."""
    found = []
    for at, reach in enumerate(NANODET_CELLS):
        middle = np.array([5 + 3 * at, 6 - 2 * at]) + 0.5
        edges = 8.0 * np.concatenate([middle - reach[:2], middle + reach[2:]])
        scale = np.array([SIDE / PICTURE[0], SIDE / PICTURE[1]])
        found.append((edges.reshape(2, 2) / scale - 0.5).ravel())
    return found
