import os
import signal
import threading

import pytest

from pseudolidar.running.signals import Stopped, StopSignals


def send(number):
    os.kill(os.getpid(), number)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_raises_with_its_exit_code(number, code):
    with pytest.raises(Stopped) as caught, StopSignals():
        send(number)
    assert caught.value.exit_code == code


def interrupted_while_held(reached, *, times=1, error=None):
    """Get signals inside a held block; notes how far it came."""
    with StopSignals() as signals:
        with signals.held():
            for _ in range(times):
                send(signal.SIGINT)
            reached.append("end of the block")
            if error is not None:
                raise error
        reached.append("behind the block")


def test_a_held_block_is_finished_first():
    reached = []
    with pytest.raises(Stopped):
        interrupted_while_held(reached)
    assert reached == ["end of the block"]


def test_a_second_signal_does_not_wait():
    reached = []
    with pytest.raises(Stopped):
        interrupted_while_held(reached, times=2)
    assert reached == []


def test_an_error_in_a_held_block_is_not_hidden():
    with pytest.raises(OSError, match="full"):
        interrupted_while_held([], error=OSError("full"))


def test_handlers_are_put_back():
    before = signal.getsignal(signal.SIGINT)
    with StopSignals():
        assert signal.getsignal(signal.SIGINT) != before
    assert signal.getsignal(signal.SIGINT) == before


def test_other_threads_may_use_it():
    entered = []

    def use():
        with StopSignals():
            entered.append(True)

    thread = threading.Thread(target=use)
    thread.start()
    thread.join()
    assert entered
