"""Settings of matcher and filters: turned, compared, taken back, saved."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.running.settings_json import tuned_file
from pseudolidar.viewer.answers import Answer
from pseudolidar.viewer.colouring import Colouring
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.panels.picture import PicturePanel
from pseudolidar.viewer.panels.time import escaped
from pseudolidar.viewer.panels.tune_part import PartControls
from pseudolidar.viewer.pictures import Layer, disparity_of
from pseudolidar.viewer.reel import SourceReel
from pseudolidar.viewer.stage import Look
from pseudolidar.viewer.tuning.bench import Bench
from pseudolidar.viewer.tuning.figures import range_table_of, table_of
from pseudolidar.viewer.tuning.judge import Judge, Judged, difference_picture
from pseudolidar.viewer.tuning.knobs import Knob, Part
from pseudolidar.viewer.tuning.side_by_side import KEPT_CLOUD, Shown
from pseudolidar.viewer.tuning.tuner import Progress, Tuner, Wanted, Workshop
from pseudolidar.viewer.view import View

TITLES = {
    "matcher": "Matcher",
    "clean": "Clean: remove what is no surface",
    "temporal": "Fuse with the frames before",
    "smooth": "Smooth",
    "fill": "Fill holes",
    "reproject": "Which pixels become points",
    "outliers": "Remove lonely points",
}
PLAIN_TITLE = "The two eyes, before matching"
UNDO, DEFAULTS, KEEP, BACK = "Undo", "Defaults", "Keep as A", "Back to A"
ONE, TWO = "B, as set below", "A, as kept"
BOTH = "both clouds, A plain"
SHOWN: dict[str, Shown] = {ONE: "B", TWO: "A", BOTH: "both"}
FILE_NAME = "settings.json"
SAVE = f"""<div style="font-size:0.85em;margin:2px 10px;line-height:1.7">
<a href="/tune/settings" download="{FILE_NAME}">Save as {FILE_NAME}</a>, then:<br>
<code>pseudolidar convert SOURCE out --settings {FILE_NAME}</code></div>"""


class TunePanel:
    """Every setting as a control; what it does is seen at once.

    Args:
        view: what is looked at.
        source: the frames by the first settings.
        workshop: how others are made.
        picture: shows the pictures of both settings, and measures by the present ones.
    """

    def __init__(
        self, view: View, source: SourceReel, workshop: Workshop[Any], picture: PicturePanel
    ) -> None:
        self._view, self._workshop, self._picture = view, workshop, picture
        self._bench = Bench(workshop.job)
        self._measured = workshop.job
        self._lock, self._syncing = threading.RLock(), False
        self.tuner = Tuner(view, source, workshop, self._told)
        self.judge = Judge(self._judged, makes_way=lambda: view.timeline.playing)
        view.on_stop(self.judge.close)
        view.server.pages |= {"/tune/settings": self._settings}
        view.stage.looks.setdefault(KEPT_CLOUD, Look(Colouring("plain")))
        gui = view.gui
        self._said = gui.add_markdown("*Move a slider: the frame is matched anew at once.*")
        self._figures = gui.add_markdown("")
        self._buttons = gui.add_button_group("", (UNDO, DEFAULTS, KEEP, BACK))
        self._shown = gui.add_dropdown("Shown", tuple(SHOWN), initial_value=ONE, visible=False)
        self._pair = gui.add_folder("A and B, one over the other", visible=False)
        with self._pair:
            self._both = gui.add_image(np.zeros((1, 1, 3), np.uint8), format="png")
        self._parts = self._add_parts()
        self._by_range = gui.add_folder("Error of depth by range", expand_by_default=False)
        with self._by_range:
            self._ranges = gui.add_markdown("")
        gui.add_html(SAVE)
        self._buttons.on_click(lambda _: self.press(self._buttons.value))
        self._shown.on_update(lambda _: self._ask())
        self._add_layers()
        self._sync()
        view.on_shown(self.judge.ask)

    def _add_parts(self) -> list[PartControls]:
        gui, parts = self._view.gui, self._bench.parts.values()
        controls = []
        for part in parts:
            if not part.plain:
                with gui.add_folder(TITLES[part.name], expand_by_default=part.name == "matcher"):
                    controls.append(PartControls(gui, part, self.choose, self.turn))
        with gui.add_folder(PLAIN_TITLE, expand_by_default=False):
            controls += [
                PartControls(gui, part, self.choose, self.turn) for part in parts if part.plain
            ]
        return controls

    def _add_layers(self) -> None:
        def there(moment: Moment) -> bool:
            return moment.compared is not None

        def kept(moment: Moment) -> Any:
            assert moment.compared is not None
            return disparity_of(moment.compared[0])

        def difference(moment: Moment) -> Any:
            assert moment.compared is not None
            a, b = (one.disparity for one in moment.compared)
            assert a is not None
            assert b is not None
            return difference_picture(a.values, b.values)

        self._picture.add_layer("disparity A", Layer(there, kept))
        self._picture.add_layer("B - A", Layer(there, difference))

    def turn(self, part: Part, knob: Knob, value: Any) -> None:
        """Set a knob; what cannot be so is told, and changes nothing."""
        self._change(lambda: self._bench.turn(part, knob, value, time.monotonic()))

    def choose(self, part: Part, kind: str) -> None:
        """Take another matcher or filter, or none."""
        self._change(lambda: self._bench.choose(part, kind, time.monotonic()))

    def _change(self, change: Any) -> None:
        with self._lock:
            if self._syncing:
                return
            try:
                changed = change()
            except PseudolidarError as refusal:
                self._said.content = f"**Not possible:** {escaped(str(refusal))}"
                return
            self._sync()
            if changed:
                self._ask()

    def press(self, button: str) -> None:
        """One of the buttons."""
        with self._lock:
            bench = self._bench
            steps = {UNDO: bench.undo, DEFAULTS: bench.reset, KEEP: bench.keep, BACK: bench.restore}
            if button in steps:
                steps[button]()
            if button == KEEP:
                self._shown.visible = True
            self._sync()
            self._ask()

    def _ask(self) -> None:
        """Show what is set."""
        with self._lock:
            job = self._bench.job
            kept = self._bench.kept if self._shown.visible else None
            self.tuner.ask(Wanted(job, kept, SHOWN[self._shown.value]))
            self._measure()

    def _measure(self) -> None:
        """Measure by what is set, too."""
        job = self._bench.job
        measuring = self._workshop.measuring(job)
        if measuring is not None and job != self._measured:
            self._measured = job
            self._picture.measure_by(measuring)

    def _sync(self) -> None:
        """Let the controls show the settings."""
        with self._lock:
            self._syncing = True
            try:
                for controls in self._parts:
                    part = controls.part
                    controls.show(self._bench.kind(part), partial(self._bench.value, part))
            finally:
                self._syncing = False

    def _told(self, progress: Progress[Any]) -> None:
        if progress.refused:
            with self._lock:
                if self._bench.job == progress.wanted.job:
                    self._bench.undo()
                    self._sync()
                    self._measure()
                self._said.content = f"**Not possible:** {escaped(progress.refused)}"
            return
        size = "in full" if progress.matched_at == 1 else f"at 1/{1 / progress.matched_at:.0f} size"
        self._said.content = f"*matched {size} after {progress.seconds:.2f} s*"

    def _judged(self, judged: Judged) -> None:
        by = next((figures.by for _, figures in judged.rows if figures.by), "")
        against = f"against {by}" if by else "no truth, no LiDAR: nothing to compare with"
        first = "a first look, " if judged.moment.matched_at < 1 else ""
        said = f"{table_of(judged.rows)}\n\n*{first}{against}*"
        self._figures.content = said if judged.rows else ""
        ranges = range_table_of(judged.rows)
        self._by_range.visible = bool(ranges)
        self._ranges.content = ranges
        self._pair.visible = judged.picture is not None
        if judged.picture is not None:
            self._both.image = judged.picture

    def _settings(self, _query: Mapping[str, str]) -> Answer:
        """The file of settings, as they are now."""
        with self._lock:
            settings = self._bench.as_json()
        moment = self._view.moment
        about = {
            "by": "view",
            "source": self._view.reel.name,
            "frame": None if moment is None else moment.id,
        }
        return Answer(tuned_file(settings, about), download=FILE_NAME)
