"""The trials of an installation: what they try is what a conversion needs."""

import subprocess
import sys
from pathlib import Path

import pseudolidar

PACKAGE = Path(pseudolidar.__file__).parent
WARMING = ("images", "matcher", "filters", "obstacles", "clouds", "worlds")
CHILD = """
import sys
from pseudolidar.running.installation.part_trials import TRIALS
for name in sys.argv[1:]:
    TRIALS[name]()
print(*(name for name in sys.modules if name.startswith("pseudolidar.")))
"""


def kernel_modules():
    """Modules with kernels of their own: those that name numba's compiler."""
    return {
        ".".join(("pseudolidar", *path.relative_to(PACKAGE).with_suffix("").parts))
        for path in PACKAGE.rglob("*.py")
        if "import njit" in path.read_text() or ", njit" in path.read_text()
    }


def test_every_kernel_is_compiled_by_a_trial():
    ended = subprocess.run(
        [sys.executable, "-c", CHILD, *WARMING], capture_output=True, text=True, check=True
    )
    loaded = set(ended.stdout.splitlines()[-1].split())
    assert len(kernel_modules()) >= 9
    assert kernel_modules() - loaded == set()
