"""Who listens at a port that is taken."""

import os
import socket
from pathlib import Path

import pytest

from pseudolidar.errors import ServeError
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.port_owner import PROC, command_of, port_owner

pytestmark = pytest.mark.skipif(not PROC.exists(), reason="only Linux tells")


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_the_process_at_a_port_is_named(host: str):
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listening = socket.create_server((host, 0), family=family)
    except OSError:
        pytest.skip(f"no {host} here")
    with listening:
        port = listening.getsockname()[1]
        owner = port_owner(port)
        assert owner is not None
        assert owner.endswith(f"(process {os.getpid()})")
        assert "\0" not in owner
    assert port_owner(port) is None


def test_an_error_of_a_taken_port_says_whose_it_is():
    with socket.create_server(("127.0.0.1", 0)) as listening:
        address = Address(port=listening.getsockname()[1])
        with pytest.raises(ServeError, match=f"in use by .*process {os.getpid()}"):
            address.bound()


def test_what_a_process_does_is_seen_wherever_its_program_lies(tmp_path: Path):
    program = f"/home/{'x' * 80}/bin/python3\0/home/{'y' * 80}/bin/pseudolidar\0view\0out/drive\0"
    (tmp_path / "cmdline").write_text(program)
    assert command_of(tmp_path) == "python3 pseudolidar view out/drive"
