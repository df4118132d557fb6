"""Numbers as people read them: shares in percent, lengths, counts, intervals."""

from __future__ import annotations

from pseudolidar.evaluation.comparison.bootstrap import Interval


def percent(share: float | None, *, digits: int = 2, signed: bool = False) -> str:
    """A share for people, a dash for none."""
    if share is None:
        return "-"
    value = round(100 * share, digits) + 0.0  # and no -0.00
    return f"{value:{'+' if signed else ''}.{digits}f} %"


def bare(share: float | None, *, digits: int = 2, signed: bool = False) -> str:
    """A share in percent, under a head that says so."""
    return percent(share, digits=digits, signed=signed).removesuffix(" %")


def between(bounds: Interval | None, *, digits: int = 2, signed: bool = False) -> str:
    """An interval of shares in percent, a dash for none."""
    if bounds is None:
        return "-"
    return " to ".join(bare(bound, digits=digits, signed=signed) for bound in bounds)


def metres(length_m: float) -> str:
    """A length for people."""
    return f"{length_m:.1f} m" if length_m >= 1 else f"{length_m:.3f} m"


def bare_metres(length_m: float | None) -> str:
    """A length to the millimetre, under a head that says so; a dash for none."""
    return "-" if length_m is None else f"{length_m:.3f}"


def counted(n: int, what: str) -> str:
    """`1 frame`, `2 frames`."""
    return f"{n:,} {what}{'' if n == 1 else 's'}"
