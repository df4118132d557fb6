"""Pictures as a differently exposed eye would have taken them."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.photometric import radius2_of

# 40 % either way of each, colour casts, corners that lose 40 % of their light, and all together.
CASES = {
    "gain 1.4": {"gain": 1.4},
    "gain 0.6": {"gain": 0.6},
    "gamma 1.4": {"gamma": 1.4},
    "gamma 0.6": {"gamma": 0.6},
    "red 1.4, blue 0.71": {"tint": 1.4},
    "red 0.71, blue 1.4": {"tint": 1 / 1.4},
    "corners 0.6": {"vignetting": -0.5},
    "together": {"gain": 0.7, "gamma": 1.3, "tint": 1.2, "vignetting": -0.3},
}


def exposed(image, *, gain=1.0, gamma=1.0, tint=1.0, vignetting=0.0):
    """The picture by another gain, gamma, colour cast and vignetting; clipped, of its kind."""
    white = np.iinfo(image.dtype).max
    shares = (np.atleast_3d(image) / white) ** gamma * gain
    if shares.shape[2] == 3:
        shares = shares * np.array([tint, 1.0, 1.0 / tint])
    shares = shares * np.exp(vignetting * radius2_of(image.shape[:2]))[:, :, None]
    out = np.clip(np.rint(white * shares), 0, white).astype(image.dtype)
    return out.reshape(image.shape)
