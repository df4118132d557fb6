"""From a turn of a setting to its picture: the first look and the whole one, against a conversion.

    python -m tests.benchmarks.tuning [TURNS]

The first frame of KITTI raw drive 0002 (without the data, of a rendered street), a turn of one
setting of each matcher after the other, as tab Tune does it, without a browser. Beside it what
`convert` takes for the same frame by the same settings, loaded, in the same run.
"""

from __future__ import annotations

import statistics
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from pseudolidar.pipelines.convert import (  # type: ignore[import-untyped]
    Convert,
    ConvertFrame,
    opened,
)

from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.reel import SourceReel
from pseudolidar.viewer.server import serve
from pseudolidar.viewer.tuning.tuner import Progress, Tuner, Wanted, Workshop
from pseudolidar.viewer.view import View
from tests.conftest import DATA

MATCHERS = {
    "census fast": Census(),
    "census fine": Census(quality="fine"),
    "sgbm 3way": Sgbm(mode="3way"),
    "sgbm hh": Sgbm(mode="hh"),
    "bm": Bm(),
}
# No turn takes longer, s.
PATIENCE_S = 60.0


def main(turns: int) -> None:
    """Print a table."""
    raw = DATA / "kitti_raw" / "2011_09_26"
    job = Convert(KittiRaw(str(raw)) if raw.is_dir() else Synthetic("street", frames=3), Path())
    source = opened(job)

    def load(settings: Any) -> Any:
        return ConvertFrame.of(settings, source).converted

    reel = SourceReel(source, load(job))
    told: list[Progress[Any]] = []
    view = View(serve(Address(port=0), label="benchmark"), reel)
    tuner = Tuner(view, reel, Workshop(job, load), told.append)
    view.start()
    print(f"{turns} turns, median (largest), s; {source.load(0).size_px} px")
    print(f"{'':12s}  {'first look':>14s}  {'whole':>14s}  {'convert':>8s}  ratio")
    for name, matcher in MATCHERS.items():
        looks, wholes, alone = [], [], []
        for turn in range(turns + 1):  # the first one compiles
            told.clear()
            turned = replace(job, matcher=replace(matcher, uniqueness_percent=5 + turn))
            tuner.ask(Wanted(turned))
            assert tuner.idle(PATIENCE_S)
            convert, frame = load(turned), source.load(0)
            begun_s = time.perf_counter()
            convert(frame)
            alone.append(time.perf_counter() - begun_s)
            looks.append(told[0].seconds)
            wholes.append(told[-1].seconds)
        middle = [statistics.median(each[1:]) for each in (looks, wholes, alone)]
        print(
            f"{name:12s}  {middle[0]:6.2f} ({max(looks[1:]):4.2f})  {middle[1]:6.2f} "
            f"({max(wholes[1:]):4.2f})  {middle[2]:8.2f}  {middle[1] / middle[2]:5.2f}"
        )
    view.stop()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
