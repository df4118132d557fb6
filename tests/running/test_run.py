"""What a run counts as done when its loop over the frames is left early."""

from __future__ import annotations

from pathlib import Path

import pytest
from pseudolidar.pipelines.obstacles import Obstacles

from pseudolidar.running.crew.attempt import Done
from pseudolidar.running.reports.obstacles_report import TOO_NEAR
from pseudolidar.running.run import Run
from pseudolidar.sources.synthetic import Synthetic


@pytest.mark.parametrize("halted", [True, False])
def test_the_last_frame_counts_if_the_run_was_halted_there_and_not_if_it_was_left(
    tmp_path: Path, halted: bool
):
    source = Synthetic("street", frames=3, width_px=128).open()
    job = Obstacles(source=Synthetic("street"), out=tmp_path)
    with Run.open(tmp_path, job, source) as run:
        passed = run.good([Done(name, index, name, 0.0) for index, name in enumerate(source.ids)])
        next(passed)
        next(passed)
        if halted:
            run.halt(TOO_NEAR)
        passed.close()
        assert run.result().passed_now == 1 + halted
