"""The state of odometry as bytes, and back; nothing but data comes back, whatever the bytes are.

Pickle, for the state is a graph: a picture that is the newest keyframe and the last frame is one.
What is read back may only be made of classes named here and of dataclasses of stages that hold
numbers; things of the world outside, such as open files, are left out and put in by who reads.
"""

from __future__ import annotations

import dataclasses
import importlib
import io
import pickle
from collections.abc import Mapping
from types import FunctionType
from typing import Any, ClassVar

PROTOCOL = 5
# The opcode by which objects get their attributes.
BUILD = pickle.BUILD[0]
# Packages whose dataclasses are data.
OF_DATA = ("pseudolidar.structures.", "pseudolidar.geometry.", "pseudolidar.mapping.")
# Classes with a state, and what makes parts of libraries anew of data.
MAPPING = {
    "disparity_offset": ("OffsetEstimate",),
    "extrapolating": ("ExtrapolatingChain",),
    "fused_chain": ("FusedChain",),
    "fused_path": ("FusedPath",),
    "keyframes": ("Keyframes",),
    "kiss_chain": ("KissChain",),
    "kiss_library": ("map_with", "point_to_point", "threshold_after"),
    "loops": ("LoopSearch",),
    "odometry": ("VisionChain",),
    "path": ("Path",),
    "place_store": ("PlaceStore",),
    "scan_map": ("ScanMap",),
    "scan_odometry": ("ScanChain",),
    "scan_witness": ("ScanWitness",),
    "surface_map": ("SurfaceMap",),
    "visual_odometry": ("VisualChain",),
}
WALK = {
    "pseudolidar.running.mapped.walk": ("Walk",),
    "pseudolidar.running.mapped.walked": ("Placed",),
    "pseudolidar.errors": ("OdometryLost", "_rebuild"),
}
LIBRARIES = {
    "array": ("array", "_array_reconstructor"),
    "builtins": ("list", "set", "frozenset"),
    "collections": ("Counter", "OrderedDict", "deque"),
    "numpy": ("dtype", "ndarray"),
    "numpy._core.multiarray": ("_reconstruct", "scalar"),
    "numpy._core.numeric": ("_frombuffer",),
}
KNOWN = {
    **{f"pseudolidar.mapping.{module}": names for module, names in MAPPING.items()},
    **WALK,
    **LIBRARIES,
}


def encode_state(state: object, outside: Mapping[str, object]) -> bytes:
    """A state as bytes.

    Args:
        state: of data, and of the classes named here.
        outside: what is left out, by a name for it.
    """
    stream = io.BytesIO()
    _Writer(stream, outside).dump(state)
    return stream.getvalue()


def decode_state(data: bytes, outside: Mapping[str, object]) -> Any:
    """A state of bytes, with what is outside put in.

    Raises:
        ValueError: these are no bytes of a state, or of another version's.
    """
    try:
        return _Reader(io.BytesIO(data), outside).load()
    except Exception as error:  # damaged bytes raise whatever there is
        raise ValueError(f"{type(error).__name__}: {error}") from error


class _Writer(pickle.Pickler):
    def __init__(self, stream: io.BytesIO, outside: Mapping[str, object]) -> None:
        super().__init__(stream, PROTOCOL)
        self._names = {id(thing): name for name, thing in outside.items()}

    def persistent_id(self, obj: object) -> str | None:
        return self._names.get(id(obj))


def _build(reader: Any) -> None:
    """Give attributes to what was made of these bytes, and to nothing else."""
    changed = reader.stack[-2]
    if isinstance(changed, type | FunctionType) or reader.is_outside(changed):
        raise pickle.UnpicklingError(f"attributes of {changed!r} are no data")
    pickle._Unpickler.dispatch[BUILD](reader)


# That of Python, not of C, which cannot be asked what it gives attributes to: 25 MB of a state are
# read in 0.03 s, not 0.02 (2 cores, 2026-11-27).
class _Reader(pickle._Unpickler):
    dispatch: ClassVar[dict[int, Any]] = {**pickle._Unpickler.dispatch, BUILD: _build}

    def __init__(self, stream: io.BytesIO, outside: Mapping[str, object]) -> None:
        super().__init__(stream)
        self._outside = outside

    def is_outside(self, thing: object) -> bool:
        return any(thing is one for one in self._outside.values())

    def persistent_load(self, pid: Any) -> object:
        return self._outside[pid]

    def find_class(self, module: str, name: str) -> Any:
        if name in KNOWN.get(module, ()) or module.startswith(OF_DATA):
            found = getattr(importlib.import_module(module), name)
            if module in KNOWN and name in KNOWN[module]:
                return found
            if isinstance(found, type) and dataclasses.is_dataclass(found):
                return found
        raise pickle.UnpicklingError(f"{module}.{name} is no data")
