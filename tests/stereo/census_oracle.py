"""The census matcher once more in plain numpy, written from its definition: the test oracle."""

from __future__ import annotations

import numpy as np

from pseudolidar.stereo.sigma_model import SigmaModel

NONE = np.float32(-1e4)
WORST = 32


def census(image):
    height, width = image.shape
    padded = np.pad(image, ((3, 3), (4, 4)), mode="edge")
    words = np.zeros((height, width), np.uint32)
    offsets = [(dy, dx) for dy in range(-3, 4) for dx in range(-4, 5) if (dx + dy) % 2]
    for bit, (dy, dx) in enumerate(offsets[:32]):
        darker = padded[3 + dy : 3 + dy + height, 4 + dx : 4 + dx + width] < image
        words |= darker.astype(np.uint32) << np.uint32(bit)
    return words


def shifted_half(image):
    p = np.pad(image.astype(np.int64), ((0, 0), (1, 2)), mode="edge")
    value = 9 * (p[:, 1:-2] + p[:, 2:-1]) - p[:, :-3] - p[:, 3:]
    return np.clip((value + 8) >> 4, 0, 255).astype(np.uint8)


def bin_disparities(bins, half_bins):
    k = np.arange(bins)
    return np.where(k < half_bins, k / 2, half_bins / 2 + (k - half_bins))


def costs(left, right, bins, half_bins):
    height, width = left.shape
    words, whole = census(left), census(right)
    half = census(shifted_half(right))
    volume = np.full((height, width, bins), WORST, np.int64)
    for k, d in enumerate(bin_disparities(bins, half_bins)):
        # a half-pixel disparity looks at x - ceil(d) + 1/2
        source, step = (half, int(np.ceil(d))) if d % 1 else (whole, int(d))
        if step < width:
            difference = words[:, step:] ^ source[:, : width - step]
            volume[:, step:, k] = np.bitwise_count(difference)
    return volume


def path(volume, penalties):
    """Eq. 13 along axis 0 of (n, m, bins)."""
    small, large = penalties
    out = np.empty_like(volume)
    previous = np.zeros_like(volume[0])
    for i, cost in enumerate(volume):
        low = previous.min(axis=1, keepdims=True)
        below = np.pad(previous, ((0, 0), (1, 0)), constant_values=10**6)[:, :-1]
        above = np.pad(previous, ((0, 0), (0, 1)), constant_values=10**6)[:, 1:]
        near = np.minimum(below, above) + small
        best = np.minimum(np.minimum(previous, near), low + large)
        previous = out[i] = cost + best - low
    return out


def sums(volume, penalties):
    sideways = volume.transpose(1, 0, 2)
    return (
        path(volume, penalties)
        + path(volume[::-1], penalties)[::-1]
        + path(sideways, penalties).transpose(1, 0, 2)
        + path(sideways[::-1], penalties)[::-1].transpose(1, 0, 2)
    )


def winners(total, half_bins, uniqueness, agreement_px):
    """Disparity, verdict, distinctness; float32 in the same order of operations as the kernel."""
    f = np.float32
    height, width, bins = total.shape
    exclude = 2 if half_bins else 1
    disparity = np.empty((height, width), f)
    verdict = np.zeros((height, width), np.uint8)
    distinct = np.empty((height, width), f)
    for y in range(height):
        cheapest, kept = np.full(width, 0xFFFF), np.zeros(width, f)
        unique = np.zeros(width, bool)
        for x in range(width):
            s = total[y, x]
            k = int(s.argmin())
            best = f(s[k])
            low = f(s[k - 1]) - best if k > 0 else f(0)
            high = f(s[k + 1]) - best if k < bins - 1 else f(0)
            others = np.delete(s, range(max(0, k - exclude), min(bins, k + exclude + 1)))
            second = f(others.min())
            step = (low - high) / max(f(2) * max(low, high), f(1))
            if k < half_bins:
                d = f(0.5) * (f(k) + step)
            elif k == half_bins and step < 0:
                d = f(k) - f(0.5) * f(half_bins) + f(0.5) * step
            else:
                d = f(k) - f(0.5) * f(half_bins) + step
            disparity[y, x] = d
            distinct[y, x] = (second - best) / (best + f(1))
            unique[x] = second * (f(1) - f(uniqueness)) >= best
            target = int(f(x) - d + f(0.5))
            if target >= 0 and best < cheapest[target]:
                cheapest[target], kept[target] = best, d
        for x in range(width):
            d = disparity[y, x]
            target = max(int(f(x) - d + f(0.5)), 0)
            agrees = abs(kept[target] - d) <= f(agreement_px)
            verdict[y, x] = (1 + unique[x]) if agrees and 0 < d <= x else 0
    return disparity, verdict, distinct


def accepted(disparity, verdict):
    height, width = disparity.shape
    p = np.pad(np.where(verdict == 2, disparity, NONE), 3, constant_values=NONE)
    near = [
        np.abs(p[dy : dy + height, dx : dx + width] - disparity) < 1
        for dy in range(7)
        for dx in range(7)
    ]
    confirmed = (verdict == 1) & (np.sum(near, axis=0) >= 20)
    return ((verdict == 2) | confirmed) & (disparity > 0)


def without_speckles(disparity, valid, step_px, pixels):
    """Flood fill from each pixel."""
    height, width = disparity.shape
    keep, seen = valid.copy(), np.zeros_like(valid)
    for start in zip(*np.nonzero(valid), strict=True):
        if seen[start]:
            continue
        segment, stack = [], [start]
        seen[start] = True
        while stack:
            y, x = stack.pop()
            segment.append((y, x))
            for v, u in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
                inside = 0 <= v < height and 0 <= u < width
                if not inside or not valid[v, u] or seen[v, u]:
                    continue
                if abs(disparity[v, u] - disparity[y, x]) <= np.float32(step_px):
                    seen[v, u] = True
                    stack.append((v, u))
        if len(segment) < pixels:
            keep[tuple(np.transpose(segment))] = False
    return keep


def smoothed(disparity, valid):
    """Masked mean, support, same and spread, summed row of the window by row like the kernel."""
    f = np.float32
    height, width = disparity.shape
    padded = np.full((height + 6, width + 6), NONE, f)
    padded[3:-3, 3:-3] = np.where(valid, disparity, NONE)
    centre = padded[3:-3, 3:-3]
    threshold = np.maximum(f(0.6), np.minimum(f(3), f(0.12) * centre))
    total, support, same, spread = (np.zeros((height, width), f) for _ in range(4))
    for dy in range(7):
        row = [np.zeros((height, width), f) for _ in range(4)]
        for dx in range(7):
            d = padded[dy : dy + height, dx : dx + width]
            deviation = np.abs(d - centre)
            near, exists = deviation < threshold, d > 0
            row[0] = row[0] + np.where(near, d, f(0))
            row[1] = row[1] + near.astype(f)
            row[2] = row[2] + exists.astype(f)
            row[3] = row[3] + np.where(exists, np.minimum(deviation, threshold), f(0))
        total, same = total + row[0], same + row[1]
        support, spread = support + row[2], spread + row[3]
    mean = np.where((centre > 0) & (same >= 12), total / np.maximum(same, 1), NONE).astype(f)
    return mean, support, same, spread


def sigma(mean, support, same, spread, distinctness, model: SigmaModel):
    """In float64 with libm's logarithms; the kernel's polynomials agree to 1e-3."""
    d = np.where(mean > 0, mean, np.nan).astype(np.float64)
    count = np.maximum(support, 1)
    features = np.stack(
        [
            support / 49,
            same / count,
            np.log2(d),
            np.log2(0.02 + spread / count),
            np.log2(np.maximum(distinctness, 0.01)),
        ],
        axis=-1,
    ).astype(np.float64)
    return model.sigma_px(features)
