"""All detectors, as the choices of a setting."""

from __future__ import annotations

from pseudolidar.obstacles.cloud import Cloud
from pseudolidar.obstacles.colour import Colour
from pseudolidar.obstacles.combined import Combined
from pseudolidar.obstacles.detector import DetectorSettings
from pseudolidar.obstacles.labels import Labels
from pseudolidar.obstacles.onnx_detector import OnnxDetector
from pseudolidar.obstacles.regions import Regions
from pseudolidar.obstacles.template import Template
from pseudolidar.obstacles.within import Range

AnyDetector = Labels | OnnxDetector | Regions | Template | Colour | Range | Cloud


def asked(detector: AnyDetector | None, also: AnyDetector | None) -> DetectorSettings | None:
    """Those of two detectors that there are as one, what both see is one thing; None for none."""
    if detector is None or also is None:
        return detector or also
    return Combined((detector, also))
