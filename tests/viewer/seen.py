"""Pictures that a browser or a server gives."""

from __future__ import annotations

import cv2
import numpy as np


def pixels_of(picture: bytes) -> np.ndarray:
    return np.asarray(cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR))
