"""Small stereo networks built node by node: they really find disparities, and only when fed right.

Each is a cost volume of absolute differences, averaged over a window, with a soft minimum. Before
that the pixels are brought back to 0..255, clipped, and rounded to few grey levels: a wrong range
saturates or loses its levels. Colour is weighed as red and green only: blue says nothing.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

OPSET = 17
# To 0..255: factor and offset for R, G, B.
TO_LEVELS = {
    "raw": ([1.0] * 3, [0.0] * 3),
    "unit": ([255.0] * 3, [0.0] * 3),
    "centred": ([127.5] * 3, [127.5] * 3),
    "imagenet": ([58.395, 57.12, 57.375], [123.675, 116.28, 103.53]),
}
ELEMENTS = {
    "float32": TensorProto.FLOAT,
    "float16": TensorProto.FLOAT16,
    "uint8": TensorProto.UINT8,
}


@dataclass
class Graph:
    """Nodes and constants; every method returns the name of its result."""

    def __post_init__(self):
        self.nodes, self.constants, self.count = [], [], 0

    def name(self):
        self.count += 1
        return f"t{self.count}"

    def const(self, value, dtype=np.float32):
        name = self.name()
        self.constants.append(numpy_helper.from_array(np.asarray(value, dtype), name))
        return name

    def op(self, kind, *inputs, **attributes):
        name = self.name()
        self.nodes.append(helper.make_node(kind, list(inputs), [name], **attributes))
        return name

    def levels(self, image, normalisation, channels, step=24.0):
        """(1, 1, H, W) grey in levels of `step`."""
        factor, offset = TO_LEVELS[normalisation]
        weights = {"rgb": [0.7, 0.3, 0.0], "bgr": [0.0, 0.3, 0.7], "grey": [1.0]}[channels]
        if channels == "bgr":
            factor, offset = factor[::-1], offset[::-1]
        n = len(weights)
        shape = (1, n, 1, 1)
        x = self.op("Mul", image, self.const(np.reshape(factor[:n], shape)))
        x = self.op("Add", x, self.const(np.reshape(offset[:n], shape)))
        x = self.op("Clip", x, self.const(0.0), self.const(255.0))
        x = self.op("Conv", x, self.const(np.reshape(weights, shape)))
        x = self.op("Round", self.op("Div", x, self.const(step)))
        return self.op("Mul", x, self.const(step))

    def shifted(self, right, disparities, ahead=0):
        """(1, D, H, W): the right image moved right by -ahead to D - 1 - ahead, nothing beyond."""
        kernel = np.zeros((disparities, 1, 1, disparities), np.float32)
        for d in range(disparities):
            kernel[d, 0, 0, disparities - 1 - d] = 1
        pads = self.const([0, 0, 0, disparities - 1 - ahead, 0, 0, 0, ahead], np.int64)
        wide = self.op("Pad", right, pads, self.const(-2000.0))
        return self.op("Conv", wide, self.const(kernel))

    def soft_minimum(self, left, moved, first, disparities, window=9):
        """(1, 1, H, W) disparity px, counted from `first`."""
        cost = self.op("Abs", self.op("Sub", left, moved))
        half = window // 2
        cost = self.op(
            "AveragePool", cost, kernel_shape=[window, window], pads=[half] * 4, count_include_pad=0
        )
        likely = self.op("Softmax", self.op("Mul", cost, self.const(-2.0)), axis=1)
        values = np.arange(first, first + disparities).reshape(1, -1, 1, 1)
        weighed = self.op("Mul", likely, self.const(values))
        return self.op("ReduceSum", weighed, self.const([1], np.int64), keepdims=1)

    def match(
        self,
        left,
        right,
        normalisation,
        channels,
        disparities,
        both_ways=False,
        step=24.0,
        window=9,
    ):
        sides = [self.levels(x, normalisation, channels, step) for x in (left, right)]
        if both_ways:  # as optical flow: matches may lie on either side
            moved = self.shifted(sides[1], 2 * disparities - 1, ahead=disparities - 1)
            return self.soft_minimum(sides[0], moved, 1 - disparities, 2 * disparities - 1)
        moved = self.shifted(sides[1], disparities)
        return self.soft_minimum(sides[0], moved, 0, disparities, window)

    def save(self, path, inputs, outputs, *, opset=OPSET, metadata=None):
        def infos(tensors):
            return [helper.make_tensor_value_info(n, ELEMENTS[t], s) for n, t, s in tensors]

        graph = helper.make_graph(
            self.nodes, "stereo", infos(inputs), infos(outputs), self.constants
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)])
        model.ir_version = 8
        if metadata:
            helper.set_model_props(model, metadata)
        onnx.checker.check_model(model)
        onnx.save(model, str(path))
        return path


def size_axes(size):
    return ["h", "w"] if size is None else [size[1], size[0]]


def two_images(
    path,
    *,
    normalisation="imagenet",
    channels="rgb",
    names=("left", "right"),
    output="disparity",
    size=None,
    sign=1.0,
    scale=1.0,
    width_unit=False,
    swapped=False,
    layout="nchw1",
    dtype="float32",
    disparities=48,
    both_ways=False,
    step=24.0,
    window=9,
    coarse=1,
    multiple=None,
    metadata=None,
):
    """Two image inputs and one output.

    `layout` of the output: nchw1 (1,1,H,W), nhw (1,H,W), flow (1,2,H,W) with x first, nhw1
    (1,H,W,1), iterations (1,3,H,W) of which the last is right, both (a coarse output before).
    """
    g = Graph()
    n = 1 if channels == "grey" else 3
    shape = [1, n, *size_axes(size)]
    feeds = list(names)
    if dtype != "float32":
        feeds = [g.op("Cast", name, to=TensorProto.FLOAT) for name in names]
    if multiple is not None:
        feeds = [fitting(g, feed, n, multiple) for feed in feeds]
    left, right = feeds[::-1] if swapped else feeds
    d = g.match(left, right, normalisation, channels, disparities, both_ways, step, window)
    if width_unit:
        extent = g.op("Cast", g.op("Gather", g.op("Shape", left), g.const(3, np.int64)), to=1)
        d = g.op("Div", d, extent)
    d = g.op("Mul", d, g.const(sign * scale))
    if coarse > 1:
        d = g.op("AveragePool", d, kernel_shape=[coarse] * 2, strides=[coarse] * 2)
    outputs, shapes = [d], [[1, 1, "oh", "ow"]]
    match layout:
        case "nhw":
            outputs, shapes = [g.op("Squeeze", d, g.const([1], np.int64))], [[1, "oh", "ow"]]
        case "flow":
            nothing = g.op("Mul", d, g.const(0.0))
            outputs, shapes = [g.op("Concat", d, nothing, axis=1)], [[1, 2, "oh", "ow"]]
        case "nhw1":
            outputs, shapes = [g.op("Transpose", d, perm=[0, 2, 3, 1])], [[1, "oh", "ow", 1]]
        case "iterations":
            parts = [g.op("Mul", d, g.const(f)) for f in (0.3, 0.8)]
            outputs, shapes = [g.op("Concat", *parts, d, axis=1)], [[1, 3, "oh", "ow"]]
        case "both":
            low = g.op("AveragePool", d, kernel_shape=[4, 4], strides=[4, 4])
            outputs, shapes = [low, d], [[1, 1, "lh", "lw"], [1, 1, "oh", "ow"]]
    out_names = [output] if len(outputs) == 1 else [f"{output}_{i}" for i in range(len(outputs))]
    kind = "float16" if dtype == "float16" else "float32"
    for tensor, name in zip(outputs, out_names, strict=True):
        g.nodes.append(helper.make_node("Cast", [tensor], [name], to=ELEMENTS[kind]))
    return g.save(
        path,
        [(name, dtype, shape) for name in names],
        [(name, kind, shape) for name, shape in zip(out_names, shapes, strict=True)],
        metadata=metadata,
    )


def fitting(g, feed, channels, multiple):
    """The image itself, by a reshape that fails unless its edges are multiples."""
    down = g.op("SpaceToDepth", feed, blocksize=multiple)
    return g.op("DepthToSpace", down, blocksize=multiple)


def stacked(
    path,
    *,
    channels="rgb",
    name="input",
    output="reference_output_disparity",
    size=None,
    normalisation="unit",
    swapped=False,
    nhwc=False,
):
    """HITNet's form: both images as channels of one input; output (1, H, W, 1)."""
    g = Graph()
    n = 3 if channels == "rgb" else 1
    shape = [1, 2 * n, *size_axes(size)]
    feed = name
    if nhwc:
        shape = [1, *size_axes(size), 2 * n]
        feed = g.op("Transpose", name, perm=[0, 3, 1, 2])
    split = g.const([n, n], np.int64)
    halves = [g.name(), g.name()]
    g.nodes.append(helper.make_node("Split", [feed, split], halves, axis=1))
    left, right = halves[::-1] if swapped else halves
    d = g.match(left, right, normalisation, channels, 48)
    g.nodes.append(helper.make_node("Transpose", [d], [output], perm=[0, 2, 3, 1]))
    return g.save(path, [(name, "float32", shape)], [(output, "float32", [1, "oh", "ow", 1])])


def coarse_to_fine(
    path,
    *,
    names=("init_left", "init_right", "next_left", "next_right"),
    size=None,
    output="next_output",
    given_flow=False,
    negative=False,
):
    """CREStereo's form: a coarse map, from the half-size pair or given, refined by +-4 px.

    The fine images are searched only around twice the coarse one: without it nothing is found.
    """
    g = Graph()
    full = [1, 3, *size_axes(size)]
    half = [1, 3, *(["hh", "hw"] if size is None else [size[1] // 2, size[0] // 2])]
    if given_flow:
        inputs = [
            (names[0], "float32", full),
            (names[1], "float32", full),
            (names[2], "float32", [1, 2, *half[2:]]),
        ]
        images = names[:2]
        coarse = g.op(
            "Slice",
            names[2],
            g.const([0], np.int64),
            g.const([1], np.int64),
            g.const([1], np.int64),
        )
        if negative:
            coarse = g.op("Neg", coarse)
    else:
        inputs = [(name, "float32", half if i < 2 else full) for i, name in enumerate(names)]
        images = names[2:]
        coarse = g.match(names[0], names[1], "raw", "rgb", 24)
    left, right = (g.levels(x, "raw", "rgb") for x in images)
    twice = g.op("Resize", coarse, "", g.const([1.0, 1.0, 2.0, 2.0]), mode="nearest")
    start = g.op("Round", g.op("Mul", twice, g.const(2.0)))
    # gather the right image at x - start - k, k = -4..4
    shape = g.op("Shape", left)
    width = g.op("Gather", shape, g.const(3, np.int64))
    columns = g.op("Range", g.const(0, np.int64), width, g.const(1, np.int64))
    columns = g.op("Reshape", g.op("Cast", columns, to=1), g.const([1, 1, 1, -1], np.int64))
    last = g.op("Cast", g.op("Sub", width, g.const(1, np.int64)), to=1)
    moved = []
    for k in range(-4, 5):
        at = g.op("Sub", g.op("Sub", columns, start), g.const(float(k)))
        at = g.op("Min", g.op("Max", at, g.const(0.0)), last)
        moved.append(g.op("GatherElements", right, g.op("Cast", at, to=TensorProto.INT64), axis=3))
    residual = g.soft_minimum(left, g.op("Concat", *moved, axis=1), -4, 9)
    d = g.op("Add", start, residual)
    nothing = g.op("Mul", d, g.const(0.0))
    g.nodes.append(helper.make_node("Concat", [d, nothing], [output], axis=1))
    return g.save(path, inputs, [(output, "float32", [1, 2, "oh", "ow"])])


def with_iterations(path, *, names=("left", "right", "iters")):
    """FoundationStereo's form with a number of iterations: none answers nothing."""
    g = Graph()
    d = g.match(names[0], names[1], "raw", "rgb", 48)
    enough = g.op("Cast", g.op("Min", names[2], g.const([4], np.int64)), to=1)
    d = g.op("Mul", d, g.op("Div", enough, g.const([4.0])))
    g.nodes.append(helper.make_node("Identity", [d], ["disp"]))
    graph = helper.make_graph(
        g.nodes,
        "stereo",
        [helper.make_tensor_value_info(n, 1, [1, 3, "h", "w"]) for n in names[:2]]
        + [helper.make_tensor_value_info(names[2], TensorProto.INT64, [1])],
        [helper.make_tensor_value_info("disp", 1, [1, 1, "h", "w"])],
        g.constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)])
    model.ir_version = 8
    onnx.save(model, str(path))
    return path


def endless(path):
    """A graph whose loop never ends."""
    body = helper.make_graph(
        [
            helper.make_node("Identity", ["go"], ["go_out"]),
            helper.make_node("Sin", ["x"], ["x_out"]),
        ],
        "body",
        [
            helper.make_tensor_value_info("i", TensorProto.INT64, []),
            helper.make_tensor_value_info("go", TensorProto.BOOL, []),
            helper.make_tensor_value_info("x", 1, None),
        ],
        [
            helper.make_tensor_value_info("go_out", TensorProto.BOOL, []),
            helper.make_tensor_value_info("x_out", 1, None),
        ],
    )
    g = Graph()
    d = g.op("Sub", "left", "right")
    trips = g.const(np.int64(2**62), np.int64)
    go = g.const(True, np.bool_)
    g.nodes.append(helper.make_node("Loop", [trips, go, d], ["disparity"], body=body))
    shape = [1, 3, "h", "w"]
    return g.save(
        path,
        [("left", "float32", shape), ("right", "float32", shape)],
        [("disparity", "float32", shape)],
    )


def answering(path, what):
    """A graph that answers `nan` or a constant wherever the pair is grey, 0.5 everywhere."""
    g = Graph()
    d = g.op("ReduceMean", g.op("Sub", "left", "right"), axes=[1], keepdims=1)
    zero = g.op("Mul", d, g.const(0.0))
    d = g.op("Div", zero, zero) if what == "nan" else g.op("Add", zero, g.const(7.0))
    g.nodes.append(helper.make_node("Identity", [d], ["disparity"]))
    shape = [1, 3, "h", "w"]
    return g.save(
        path,
        [("left", "float32", shape), ("right", "float32", shape)],
        [("disparity", "float32", [1, 1, "h", "w"])],
    )


def sidecar(path, **layout):
    path.with_suffix(".json").write_text(json.dumps(layout))
