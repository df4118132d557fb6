"""What eyes that are exposed differently cost: census and SGBM, with and without `--balance`.

    python -m tests.benchmarks.balance [PAIRS OF KITTI]

The right eyes of real pairs are given another gain, gamma, colour cast and vignetting. Two lines
tell what of it is lost in the camera: the same gain between the eyes with nothing clipped (the left
eye is darker instead), and both eyes clipped alike, so that they do not differ at all.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pseudolidar.evaluation.disparity import DisparityScore, disparity_errors
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.stereo.balance import balanced
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.sgbm import Sgbm
from pseudolidar.structures.frame import StereoFrame
from tests.conftest import DATA
from tests.exposed import CASES, exposed
from tests.stereo.motorcycle import DISPARITIES, motorcycle

PAIRS, KITTI_DISPARITIES = 5, 128
# What is done to the left and to the right eye.
EXPOSED = {
    "as taken": ({}, {}),
    **{name: ({}, difference) for name, difference in CASES.items()},
    "gain 1.4, none clipped": ({"gain": 1 / 1.4}, {}),
    "both eyes by 1.4": ({"gain": 1.4}, {"gain": 1.4}),
}


def kitti(pairs: int) -> list[StereoFrame]:
    """So many pairs, spread over all."""
    source = KittiStereo(str(DATA / "kitti_stereo2015" / "training")).open()
    count = len(source.ids)
    return [source.load(int(i)) for i in np.linspace(0, count - 1, min(pairs, count)).round()]


def print_table(name: str, frames: Sequence[StereoFrame], disparities: int) -> None:
    """One line for each difference: D1 of matched pixels, density, D1 with gaps filled."""
    matchers = {
        f"{kind} {when}": balanced(settings, when)
        for kind, settings in (
            ("census", Census(disparities=disparities)),
            ("SGBM", Sgbm(disparities=disparities)),
        )
        for when in ("never", "auto")
    }
    print(f"{name}, {len(frames)} pairs; D1, density, D1 filled in %, by --balance")
    print(f"  {'':22s}" + "".join(f"{title:>19s}" for title in matchers))
    for case, (left, right) in EXPOSED.items():
        pairs = [
            replace(each, left=exposed(each.left, **left), right=exposed(each.right, **right))
            for each in frames
        ]
        columns = []
        for matcher in matchers.values():
            score = DisparityScore([disparity_errors(matcher(p), p.truth) for p in pairs])
            shares = (score.d1_est, score.density, score.d1_filled)
            columns.append("{:8.2f} {:4.1f} {:5.2f}".format(*(100 * share for share in shares)))
        print(f"  {case:22s}" + "".join(columns), flush=True)


def main() -> None:
    """Print both tables."""
    pairs = int(sys.argv[1]) if len(sys.argv) > 1 else PAIRS
    print_table("KITTI stereo 2015", kitti(pairs), KITTI_DISPARITIES)
    print_table("Middlebury motorcycle", [motorcycle(DATA)], DISPARITIES)


if __name__ == "__main__":
    main()
