"""What is odd about the classes of a run's labels: those asked for and those nobody knows."""

from __future__ import annotations

from collections.abc import Iterable

from pseudolidar.formats.labels import KNOWN_CLASSES
from pseudolidar.obstacles.detector import DetectorSettings
from pseudolidar.obstacles.labels import Labels
from pseudolidar.running.journal.record import FrameRecord

# The figure of a frame that names the classes of its labels.
LABELLED = "labelled_classes"


def class_warnings(
    detectors: Iterable[DetectorSettings | None], records: Iterable[FrameRecord]
) -> list[str]:
    """Classes that were asked for and no frame has, and classes that KITTI does not have.

    Args:
        detectors: those that were asked; nothing is odd where labels are not among them.
        records: of the frames that are done.
    """
    asked = [one.classes for one in detectors if isinstance(one, Labels)]
    told = [record.figures[LABELLED] for record in records if LABELLED in record.figures]
    if not asked or not told:
        return []
    there = sorted({name for names in told for name in names})
    known = {name.lower() for name in there}
    absent = [name for names in asked for name in names if name.lower() not in known]
    lines = [
        f"labels: no frame has the class {name}; there are {', '.join(there) or 'none'}"
        for name in absent
    ]
    if strange := sorted(set(there).difference(KNOWN_CLASSES)):
        lines.append(f"labels: classes that KITTI does not have: {', '.join(strange)}")
    return lines
