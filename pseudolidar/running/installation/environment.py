"""Whether this machine and installation are fit: every part is tried for real."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from pseudolidar.formats.atomic import free_bytes
from pseudolidar.running.kernel_cache import is_writable, kernel_cache_folder

TRIAL_TIMEOUT_S = 300  # compiling all kernels takes 5 s to 1 min
LITTLE_DISK_BYTES = 2_000_000_000  # 300 KITTI frames as PCD and MCAP
_AT_ONCE = 2


@dataclass(frozen=True)
class Part:
    """A part of the package that works or not.

    Args:
        name: of its trial.
        serves: what does not work without it.
        packages: what pip installs for it, by the module that is imported.
        core: whether converting recorded pairs needs it.
    """

    name: str
    serves: str
    packages: dict[str, str]
    core: bool = True


@dataclass(frozen=True)
class Finding:
    """What was found out about a part or about the machine.

    Args:
        name: what was looked at.
        fine: whether it is as it should be.
        found: what works, or what does not.
        fix: what to do about it, empty if nothing.
        core: whether the core fails with it.
    """

    name: str
    fine: bool
    found: str
    fix: str = ""
    core: bool = False


PARTS = (
    Part("images", "pictures", {"cv2": "opencv-python-headless"}),
    Part("matcher", "matching and reprojection", {"numba": "numba", "llvmlite": "numba"}),
    Part("clouds", "point cloud files", {"numba": "numba", "llvmlite": "numba"}),
    Part(
        "recordings",
        "MCAP",
        {
            "mcap": "mcap",
            "foxglove_schemas_protobuf": "foxglove-schemas-protobuf",
            "google": "protobuf",
            "isal": "isal",
            "lz4": "lz4",
            "zstandard": "zstandard",
        },
    ),
    Part("networks", "networks as matchers", {"onnxruntime": "onnxruntime"}, core=False),
    Part("reports", "report.html", {"matplotlib": "matplotlib", "jinja2": "jinja2"}, core=False),
    Part(
        "worlds",
        "synthetic sources",
        {"open3d": "open3d", "libusb_package": "libusb-package"},
        core=False,
    ),
)

# Shared libraries of the system by the start of their file name: Debian's package.
_SYSTEM_PACKAGES = {
    "libGL.": "libgl1",
    "libEGL.": "libegl1",
    "libgomp.": "libgomp1",
    "libX11.": "libx11-6",
    "libglib-2.": "libglib2.0-0",
    "libusb-1.": "libusb-1.0-0",
    "libstdc++.": "libstdc++6",
}


def try_parts() -> tuple[Finding, ...]:
    """Try every part, each in a process of its own, so that none can take the others down."""
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        return tuple(pool.map(try_part, PARTS))


def look_at_machine() -> tuple[Finding, ...]:
    """Processor, cores, free disk, and where compiled kernels are kept."""
    answer = _trial("processor")
    folder = kernel_cache_folder()
    writable = is_writable(folder)
    return (
        Finding("processor", "found" in answer, answer.get("found") or answer["got"]),
        Finding("cores", True, f"{usable_cores()} of {os.cpu_count()} may be used"),
        _disk("disk here", Path.cwd()),
        _disk("disk for temporary files", Path(tempfile.gettempdir())),
        Finding(
            "kernel cache",
            writable,
            f"{folder}" + ("" if writable else " cannot be written"),
            "" if writable else "Set NUMBA_CACHE_DIR to a folder that can be written.",
        ),
    )


def usable_cores() -> int:
    """Cores that this process may run on."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def try_part(part: Part) -> Finding:
    """Try one part in a process of its own."""
    answer = _trial(part.name)
    if "found" in answer:
        return Finding(part.name, True, answer["found"], core=part.core)
    fix = answer["fix"] or _advice(part, answer["got"], answer.get("module", ""))
    return Finding(part.name, False, f"no {part.serves}: {answer['got']}", fix, part.core)


def _trial(name: str) -> dict[str, str]:
    """The answer of a trial, which always has `found` or `got` and `fix`."""
    command = [sys.executable, "-m", "pseudolidar.running.installation.part_trials", name]
    try:
        ended = subprocess.run(
            command, capture_output=True, text=True, timeout=TRIAL_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return {"got": f"no answer within {TRIAL_TIMEOUT_S} s", "fix": ""}
    if ended.returncode < 0:
        return {"got": _killed(-ended.returncode), "fix": ""}
    try:
        answer: dict[str, str] = json.loads(ended.stdout.splitlines()[-1])
    except (ValueError, IndexError):
        lines = ended.stderr.strip().splitlines() or ["no answer"]
        return {"got": lines[-1], "fix": ""}
    return answer


def _killed(number: int) -> str:
    name = signal.Signals(number).name
    if number == signal.SIGILL:
        return f"{name}: the installed build uses instructions that this processor lacks"
    return f"ended by {name}"


def _advice(part: Part, got: str, module: str) -> str:
    """The package to install for what was found."""
    for start, package in _SYSTEM_PACKAGES.items():
        if start in got and ".so" in got:
            return f"Install the system's {package} (Debian: apt install {package})."
    if module in part.packages:
        return f"pip install {part.packages[module]}"
    names = " ".join(dict.fromkeys(part.packages.values()))
    return f"pip install --force-reinstall {names}"


def _disk(name: str, folder: Path) -> Finding:
    free = free_bytes(folder)
    fine = free >= LITTLE_DISK_BYTES
    fix = "" if fine else "Free some space, or write to another disk."
    return Finding(name, fine, f"{free / 1e9:.1f} GB free at {folder}", fix)
