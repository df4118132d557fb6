"""What an ONNX file says about itself, read without running or loading anything.

Tensor data stay where they lie, so that a file of gigabytes takes milliseconds. Source: onnx.proto
of the ONNX specification (field numbers).
"""

from __future__ import annotations

import hashlib
import mmap
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pseudolidar.errors import ModelError
from pseudolidar.formats.recordings.protobuf_wire import message_fields

# Formats that run code when they are loaded, and formats that other programs load.
PICKLED = (".pt", ".pth", ".pkl", ".pickle", ".joblib", ".ckpt", ".bin", ".tar")
FOREIGN = (".engine", ".plan", ".trt", ".tflite", ".pb", ".h5", ".xml", ".mlmodel", ".ort")
_PICKLE_MAGIC = (b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05", b"PK\x03\x04")
_DTYPES = {1: "float32", 2: "uint8", 3: "int8", 6: "int32", 7: "int64", 9: "bool", 10: "float16"}
_DTYPES |= {11: "float64", 16: "bfloat16"}
_DEEPEST = 32
# Field numbers of the messages.
_MODEL_GRAPH, _MODEL_METADATA, _MODEL_FUNCTION = 7, 14, 25
_FUNCTION_NODE, _FUNCTION_DEFAULT = 7, 11
_GRAPH_NODE, _GRAPH_WEIGHTS, _GRAPH_INPUT, _GRAPH_OUTPUT, _GRAPH_SPARSE_WEIGHTS = 1, 5, 11, 12, 15
_SPARSE_PARTS = (1, 2)  # values and indices, both tensors
_NODE_ATTRIBUTE = 5
_ATTRIBUTE_TENSORS, _ATTRIBUTE_GRAPHS = (5, 10), (6, 11)  # one, and a list
_TENSOR_NAME, _TENSOR_EXTERNAL, _TENSOR_PLACE = 8, 13, 14
_EXTERNAL = 1  # place of a tensor in another file
_BLOCK_BYTES = 1 << 20

Axis = int | str | None


@dataclass(frozen=True)
class TensorInfo:
    """An input or output of a network.

    Args:
        name: as in the file.
        dtype: NumPy's name, or `type N` of the specification.
        shape: a number, the name of a free axis, or None; None alone where nothing is said.
    """

    name: str
    dtype: str
    shape: tuple[Axis, ...] | None

    def __str__(self) -> str:
        axes = (
            "?"
            if self.shape is None
            else ",".join("?" if a is None else str(a) for a in self.shape)
        )
        return f"{self.name} {self.dtype}[{axes}]"


@dataclass(frozen=True)
class OnnxModel:
    """The signature of a network file.

    Args:
        path: the file.
        inputs: without those that have a stored value.
        outputs: in order.
        metadata: what its maker wrote beside it.
        external: files that hold its weights, resolved.
    """

    path: Path
    inputs: tuple[TensorInfo, ...]
    outputs: tuple[TensorInfo, ...]
    metadata: dict[str, str] = field(default_factory=dict)
    external: tuple[Path, ...] = ()

    @property
    def signature(self) -> str:
        """One line: inputs -> outputs."""
        return f"{'; '.join(map(str, self.inputs))} -> {'; '.join(map(str, self.outputs))}"

    def sha256(self) -> str:
        """Hash of the file, and of the files with its weights where there are any."""
        digest = hashlib.sha256()
        for path in (self.path, *self.external):
            with path.open("rb") as file:
                while block := file.read(_BLOCK_BYTES):
                    digest.update(block)
        return digest.hexdigest()


def read_onnx(path: Path) -> OnnxModel:
    """The signature of a network file.

    Raises:
        ModelError: absent, not ONNX, damaged, or its weights lie outside its folder.
    """
    _refuse_other_formats(path)
    try:
        with path.open("rb") as file:
            if path.stat().st_size == 0:
                raise ModelError("an empty file", want="an ONNX network", path=path)
            # Not closed by hand: views of it may still be alive in an error's traceback.
            mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            model, locations = _model(path, memoryview(mapped))
    except OSError as error:
        raise ModelError(error.strerror or str(error), want="an ONNX network", path=path) from error
    except (ValueError, RecursionError) as error:
        raise ModelError(
            f"not an ONNX network, or damaged: {error}", want="a whole .onnx file", path=path
        ) from error
    return OnnxModel(
        path, model.inputs, model.outputs, model.metadata, _external_files(path, locations)
    )


def check_sha256(model: OnnxModel, pinned: str | None) -> None:
    """Refuse another file than the pinned one, where one is pinned.

    Raises:
        ModelError: the hash differs.
    """
    if pinned is not None and (found := model.sha256()) != pinned.lower():
        raise ModelError(
            f"SHA-256 {found}",
            want=pinned,
            fix="The file is not the one that was pinned.",
            path=model.path,
            where="sha256",
        )


def _refuse_other_formats(path: Path) -> None:
    fix = "Export it to ONNX where it was trained (torch.onnx.export)."
    suffix = path.suffix.lower()
    try:
        with path.open("rb") as file:
            start = file.read(4)
    except OSError:
        start = b""  # told by what opens it next
    if suffix in PICKLED or start.startswith(_PICKLE_MAGIC):
        raise ModelError(
            "a pickle: loading it runs whatever code it holds, so it is never loaded",
            want="an ONNX network",
            fix=fix,
            path=path,
        )
    if suffix in FOREIGN:
        raise ModelError(f"a {suffix} file", want="an ONNX network", fix=fix, path=path)


def _external_files(path: Path, locations: set[str]) -> tuple[Path, ...]:
    """Files with weights, each a plain file of the network's own folder.

    Raises:
        ModelError: one is absent, or lies elsewhere: by its name, a symbolic or a hard link.
    """
    folder, found = path.resolve().parent, []
    for location in sorted(locations):
        plain = Path(location)
        place = folder / plain
        inside = not plain.is_absolute() and ".." not in plain.parts and "\\" not in location
        if not inside or place.resolve().parent != place.parent or place.is_symlink():
            raise ModelError(
                f"weights in {location!r}, a link or outside its folder",
                want="weights inside the file, or beside it",
                fix="Do not use this file unless you know who made it.",
                path=path,
            )
        if not place.is_file():
            raise ModelError(
                f"its weights {location!r} are absent", want="them beside it", path=path
            )
        if place.stat().st_nlink > 1:
            raise ModelError(
                f"weights {location!r} are a hard link, which may lead anywhere",
                want="a file of their own",
                fix="Copy them.",
                path=path,
            )
        found.append(place)
    return tuple(found)


def _model(path: Path, data: memoryview) -> tuple[OnnxModel, set[str]]:
    graphs, metadata, locations = [], {}, set[str]()
    for number, value in _views(data):
        if number == _MODEL_GRAPH:
            graphs.append(value)
        elif number == _MODEL_METADATA:
            entry = _entry(value)
            metadata[entry[0]] = entry[1]
        elif number == _MODEL_FUNCTION:
            locations |= _function_locations(value)
    if len(graphs) != 1:
        raise ValueError(f"{len(graphs)} graphs in it")
    inputs, outputs = _signature(graphs[0])
    locations |= _graph_locations(graphs[0], 0)
    return OnnxModel(path, inputs, outputs, metadata), locations


def _signature(graph: memoryview) -> tuple[tuple[TensorInfo, ...], tuple[TensorInfo, ...]]:
    """Inputs that a graph must be given, and its outputs."""
    inputs: list[TensorInfo] = []
    outputs: list[TensorInfo] = []
    stored: set[str] = set()
    for number, value in _views(graph):
        if number == _GRAPH_INPUT:
            inputs.append(_tensor_info(value))
        elif number == _GRAPH_OUTPUT:
            outputs.append(_tensor_info(value))
        elif number == _GRAPH_WEIGHTS:
            stored |= {str(v, "utf-8") for n, v in _views(value) if n == _TENSOR_NAME}
    if not inputs or not outputs:
        raise ValueError("it has no inputs or no outputs")
    # Older files list stored weights among the inputs.
    return tuple(info for info in inputs if info.name not in stored), tuple(outputs)


def _views(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    """The fields that are bytes: messages and texts."""
    for number, value in message_fields(data):
        if isinstance(value, memoryview):
            yield number, value


def _entry(data: memoryview) -> tuple[str, str]:
    fields = {number: str(value, "utf-8") for number, value in _views(data)}
    return fields.get(1, ""), fields.get(2, "")


def _tensor_info(data: memoryview) -> TensorInfo:
    name, dtype, shape = "", "nothing", None
    for number, value in _views(data):
        if number == 1:
            name = str(value, "utf-8")
        elif number == 2:
            for inner, tensor in _views(value):
                if inner == 1:  # tensor_type; sequences and maps stay "nothing"
                    dtype, shape = _tensor_type(tensor)
    return TensorInfo(name, dtype, shape)


def _tensor_type(data: memoryview) -> tuple[str, tuple[Axis, ...] | None]:
    dtype, shape = "nothing", None
    for number, value in message_fields(data):
        if number == 1 and isinstance(value, int):
            dtype = _DTYPES.get(value, f"type {value}")
        elif number == 2 and isinstance(value, memoryview):
            shape = tuple(_axis(axis) for inner, axis in _views(value) if inner == 1)
    return dtype, shape


def _axis(data: memoryview) -> Axis:
    for number, value in message_fields(data):
        if number == 1 and isinstance(value, int):
            # -1, as 64-bit two's complement, and 0 are how some exporters write a free axis
            return value if 0 < value < 1 << 62 else None
        if number == 2 and isinstance(value, memoryview):
            return str(value, "utf-8")
    return None


def _graph_locations(data: memoryview, depth: int) -> set[str]:
    """Files that the tensors of a graph, and of the graphs inside its nodes, name."""
    found: set[str] = set()
    for number, value in _views(data):
        if number == _GRAPH_NODE:
            found |= _node_locations(value, depth)
        elif number == _GRAPH_WEIGHTS:
            found |= _tensor_locations(value)
        elif number == _GRAPH_SPARSE_WEIGHTS:
            parts = (tensor for inner, tensor in _views(value) if inner in _SPARSE_PARTS)
            found = found.union(*map(_tensor_locations, parts))
    return found


def _function_locations(data: memoryview) -> set[str]:
    found: set[str] = set()
    for number, value in _views(data):
        if number == _FUNCTION_NODE:
            found |= _node_locations(value, 0)
        elif number == _FUNCTION_DEFAULT:
            found |= _attribute_locations(value, 0)
    return found


def _node_locations(data: memoryview, depth: int) -> set[str]:
    if depth > _DEEPEST:
        raise ValueError(f"graphs more than {_DEEPEST} deep")
    found: set[str] = set()
    for number, attribute in _views(data):
        if number == _NODE_ATTRIBUTE:
            found |= _attribute_locations(attribute, depth)
    return found


def _attribute_locations(data: memoryview, depth: int) -> set[str]:
    found: set[str] = set()
    for number, value in _views(data):
        if number in _ATTRIBUTE_TENSORS:
            found |= _tensor_locations(value)
        elif number in _ATTRIBUTE_GRAPHS:
            found |= _graph_locations(value, depth + 1)
    return found


def _tensor_locations(data: memoryview) -> set[str]:
    found, external = set(), False
    for number, value in message_fields(data):
        if number == _TENSOR_PLACE and value == _EXTERNAL:
            external = True
        elif number == _TENSOR_EXTERNAL and isinstance(value, memoryview):
            external = True
            key, text = _entry(value)
            found |= {text} if key == "location" else set()
    return found if external else set()
