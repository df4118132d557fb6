"""What is odd about the classes of a run's labels: asked for in vain, or unknown to KITTI."""

from __future__ import annotations

from collections.abc import Iterable

from pseudolidar.formats.labels import KNOWN_CLASSES
from pseudolidar.obstacles.detector import DetectorSettings
from pseudolidar.obstacles.labels import Labels
from pseudolidar.running.journal.record import FrameRecord

# The figure of a frame that lists the classes of its labels.
LABELLED = "labelled_classes"


def class_warnings(
    detectors: Iterable[DetectorSettings | None], records: Iterable[FrameRecord]
) -> list[str]:
    """Warnings of classes that were asked for and no frame has, and of those that KITTI has not.

    Args:
        detectors: those of the run, None for none. Where none of them are labels nothing is odd.
        records: of the frames that are done.

    Returns:
        A line for each class that was asked for in vain, and one with all that KITTI has not.
    """
    asked = [one.classes for one in detectors if isinstance(one, Labels)]
    told = [record.figures[LABELLED] for record in records if LABELLED in record.figures]
    if not asked or not told:
        return []
    there = sorted({name for names in told for name in names})
    known = {name.lower() for name in there}
    wanted = dict.fromkeys(name for names in asked for name in names)  # each once, in order
    absent = [name for name in wanted if name.lower() not in known]
    lines = [
        f"labels: no frame has the class {name}; there are {', '.join(there) or 'none'}"
        for name in absent
    ]
    if strange := sorted(set(there).difference(KNOWN_CLASSES)):
        lines.append(f"labels: classes that KITTI does not have: {', '.join(strange)}")
    return lines
