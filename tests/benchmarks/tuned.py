"""What `tune` finds on some scenes, judged by the truth of scenes that it never saw.

    python -m tests.benchmarks.tuned [MATCHERS [CANDIDATES [SEED]]]    # census,sgbm 60 0

Settings are tuned on rendered rooms, on streets, and on either half of Middlebury's motorcycle,
once by truth and once by the pairs alone, in a set number of candidates. Judged are another room,
the motorcycle, and of its halves the one that was not tuned on. All by the commands, as users do.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from pseudolidar.cli import main as pseudolidar
from tests.conftest import DATA
from tests.sources.middlebury_layouts import motorcycle, motorcycle_half

CANDIDATES, SEED = 60, 0
WORLDS = {
    "rooms": ("synthetic:room:10", "--source.seed", "11", "--source.width-px", "320"),
    "streets": ("synthetic:street:10", "--source.seed", "11", "--source.width-px", "320"),
}
OTHER_ROOM = ("synthetic:room:4", "--source.seed", "30", "--source.width-px", "640")
Line = tuple[str, ...]


def told(*arguments: str) -> dict[str, Any]:
    """What a command says as JSON."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
        pseudolidar([*arguments, "--json"])
    return dict(json.loads(out.getvalue()))


def figures(scene: Line, *settings: str) -> str:
    """D1, density, D1 filled in %, mean error in px."""
    found = told("evaluate", "disparity", *scene, *settings)
    shares = (100 * found[name] for name in ("d1_est", "density", "d1_filled"))
    return "{:5.2f} {:4.1f} {:5.2f} ".format(*shares) + f"{found['epe']:.3f}"


def scenes(folder: Path) -> tuple[dict[str, tuple[Line, tuple[str, ...]]], dict[str, Line]]:
    """What is tuned on, with the names of what is judged then; and what is judged."""
    halves = {
        half: str(motorcycle_half(DATA, folder / half / "Motorcycle", half).parent)
        for half in ("upper", "lower")
    }
    whole = str(motorcycle(DATA, folder / "whole" / "Motorcycle").parent)
    judged: dict[str, Line] = {
        "other room": OTHER_ROOM,
        "motorcycle": (whole,),
        "upper half": (halves["upper"],),
        "lower half": (halves["lower"],),
    }
    tuned_on = {name: (line, ("other room", "motorcycle")) for name, line in WORLDS.items()}
    tuned_on["upper half"] = ((halves["upper"],), ("other room", "lower half"))
    tuned_on["lower half"] = ((halves["lower"],), ("other room", "upper half"))
    return tuned_on, judged


def main() -> None:
    """Print a table for each matcher."""
    matchers = sys.argv[1].split(",") if len(sys.argv) > 1 else ["census", "sgbm"]
    candidates = sys.argv[2] if len(sys.argv) > 2 else str(CANDIDATES)
    seed = sys.argv[3] if len(sys.argv) > 3 else str(SEED)
    print(f"{candidates} candidates, seed {seed}; D1, density, D1 filled in %, mean error in px")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        tuned_on, judged = scenes(folder)
        for matcher in matchers:
            chosen = ("--matcher", matcher)
            for name, line in judged.items():
                print(f"{matcher:6s} {'defaults':20s} {name:10s} {figures(line, *chosen)}")
            for name, (line, names) in tuned_on.items():
                for by in ("truth", "pairs"):
                    out = folder / f"{matcher} {name} {by}.json"
                    search = ("--budget", "1h", "--candidates", candidates, "--seed", seed)
                    begin_s = time.process_time()
                    found = told("tune", *line, *chosen, "--by", by, *search, "--out", str(out))
                    spent_s = time.process_time() - begin_s
                    ratio = f"loss held back x {found['loss_held']:.2f}, {spent_s:.0f} s of CPU"
                    print(f"{matcher:6s} {name} by {by}: {ratio}", flush=True)
                    for other in names if found["improved"] else ():
                        told_now = figures(judged[other], "--settings", str(out))
                        print(f"{'':27s} {other:10s} {told_now}", flush=True)
                    print(f"{'':27s} {changes(found)}", flush=True)


def changes(found: dict[str, Any]) -> str:
    """Settings that are others now."""
    words = []
    for each in found["changes"]:
        now = each["now"]
        chosen = " ".join(f"{k} {v}" for k, v in now.items()) if isinstance(now, dict) else now
        words.append(f"{each['name'].removeprefix('matcher.')} {chosen}")
    return ", ".join(words) or "nothing else was clearly better"


if __name__ == "__main__":
    main()
