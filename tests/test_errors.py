"""Errors say what to do, each of them."""

import inspect

import pytest

from pseudolidar import errors
from pseudolidar.errors import PseudolidarError, UsageError

# Raised where a caller in code is wrong, not a file: what is wanted says it all.
WITHOUT = (UsageError, errors.StructureError, errors.Interrupted)
KINDS = [
    kind
    for _, kind in inspect.getmembers(errors, inspect.isclass)
    if issubclass(kind, PseudolidarError)
    and not issubclass(kind, WITHOUT)
    and not kind.__subclasses__()
]


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_has_something_to_do(kind):
    plain = kind("found", want="wanted", path="a.pcd", where="line 3")
    assert plain.fix == kind.advice != ""
    assert str(plain) == f"{kind.__name__}: a.pcd: line 3: found; wanted wanted. {kind.advice}"
    assert str(kind("found", fix="Do this.")).endswith("found. Do this.")
