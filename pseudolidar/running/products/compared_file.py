"""A compared frame as a file: what a continued run has of the frames that were done before."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pseudolidar.evaluation.cloud_distances import CloudDistances
from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.formats.rigs.rig_json import parse_rig, rig_text
from pseudolidar.running.folder import inside
from pseudolidar.structures.arrays import AnyArray

COMPARED_FOLDER = ".compared"
COLUMNS = ("u", "v", "reference_m", "disparity_px", "slope")
OPTIONAL = ("sigma_px", "place_m")
FACTS = ("id", "index", "timestamp_ns", "kind")
DISTANCES = ("accuracy_m", "estimate_range_m", "completeness_m", "reference_range_m")


def compared_name(frame_id: str) -> str:
    """Name in the output folder."""
    return f"{COMPARED_FOLDER}/{frame_id}.npz"


def encode_compared(frame: ComparedFrame) -> bytes:
    """The frame with its rig as the bytes of an NPZ; the same bytes for the same frame."""
    columns = {name: getattr(frame, name) for name in (*COLUMNS, *FACTS)}
    columns |= {n: value for n in OPTIONAL if (value := getattr(frame, n)) is not None}
    if frame.distances is not None:
        columns |= {name: getattr(frame.distances, name) for name in DISTANCES}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, rig=rig_text(frame.rig), **columns)
    return buffer.getvalue()


def read_compared(folder: Path, frame_id: str) -> ComparedFrame:
    """A frame that `encode_compared` has made, from the output folder of its run."""
    path = inside(folder, compared_name(frame_id))
    with np.load(path) as arrays:
        return ComparedFrame(
            id=str(arrays["id"]),
            index=int(arrays["index"]),
            timestamp_ns=int(arrays["timestamp_ns"]),
            rig=parse_rig(str(arrays["rig"]), path),
            **{name: arrays[name] for name in COLUMNS},
            **{name: arrays.get(name) for name in OPTIONAL},
            kind="truth" if arrays.get("kind") == "truth" else "scan",
            distances=_distances(arrays),
        )


def _distances(arrays: Mapping[str, AnyArray]) -> CloudDistances | None:
    if DISTANCES[0] not in arrays:
        return None
    return CloudDistances(*(arrays[name] for name in DISTANCES))
