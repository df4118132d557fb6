"""From light to the numbers of a sensor: gain, vignetting, shot and read noise, gamma."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Float32, UInt8

# Levels of the table that applies the gamma curve: finer than 8 bits at its steep end.
GAMMA_LEVELS = 1 << 14


@dataclass(frozen=True)
class Photometry:
    """How the two sensors turn light into grey levels, and how they differ.

    Args:
        exposure: factor on the light of the world, both eyes.
        gamma: exponent of the encoding, left eye.
        full_well_e: electrons at white: sets the shot noise.
        read_noise_e: electrons, one standard deviation.
        noise: factor on all noise; 0 for none.
        vignetting: share of light that the corners lose.
        right_gain: brightness of the right eye against the left.
        right_gamma: factor on the right eye's gamma.
        right_tint: factor on its red; its blue gets the inverse.
    """

    exposure: float = 0.9
    gamma: float = 2.2
    full_well_e: float = 9000.0
    read_noise_e: float = 12.0
    noise: float = 1.0
    vignetting: float = 0.10
    right_gain: float = 0.97
    right_gamma: float = 1.01
    right_tint: float = 1.01

    def expose(self, light: Float32, *, right: bool, rng: np.random.Generator) -> UInt8:
        """Picture (H, W, 3) RGB of linear light (H, W, 3)."""
        signal = light * self._response(light.shape[0], light.shape[1], right=right)
        if self.noise > 0:
            # Shot noise of variance n and read noise, in units of the full well.
            variance = np.maximum(signal, 0) / self.full_well_e
            variance += (self.read_noise_e / self.full_well_e) ** 2
            grain = rng.standard_normal(signal.shape, dtype=np.float32)
            signal += np.float32(self.noise) * np.sqrt(variance) * grain
        gamma = self.gamma * (self.right_gamma if right else 1.0)
        levels = np.linspace(0.0, 1.0, GAMMA_LEVELS) ** (1.0 / gamma)
        table = np.rint(255.0 * levels).astype(np.uint8)
        index = np.clip(signal * (GAMMA_LEVELS - 1) + 0.5, 0, GAMMA_LEVELS - 1)
        picture: UInt8 = table[index.astype(np.int32)]
        return picture

    def _response(self, height: int, width: int, *, right: bool) -> Float32:
        """(H, W, 3) factor from light to signal."""
        y = np.linspace(-1.0, 1.0, height, dtype=np.float32)[:, None]
        x = np.linspace(-1.0, 1.0, width, dtype=np.float32)[None, :]
        falloff = 1.0 - np.float32(0.5 * self.vignetting) * (x * x + y * y)
        tint = self.right_tint if right else 1.0
        gain = self.exposure * (self.right_gain if right else 1.0)
        colour = np.array([gain * tint, gain, gain / tint], dtype=np.float32)
        return falloff[:, :, None] * colour
