"""Waiting for descriptors: which are readable, which are closed, whatever their numbers."""

from __future__ import annotations

import fcntl
import os
import resource

import pytest

from qrobot.rci.readiness import Readiness, await_readable, check_open


def test_what_can_be_read_has_ended_or_is_closed_is_told_apart() -> None:
    (silent, held), (said, sink), (ended, gone), (closed, other) = (os.pipe() for _ in range(4))
    os.write(sink, b"a")
    for descriptor in (gone, closed, other):
        os.close(descriptor)
    assert await_readable([silent, said, ended, closed], None) == Readiness({said, ended}, {closed})
    assert await_readable([silent], 0.0005) == await_readable([], 0.0) == Readiness(set(), set())
    for descriptor in (silent, held, said, sink, ended):
        os.close(descriptor)


def test_a_number_beyond_those_that_select_knows_can_be_waited_for() -> None:
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(limits[0], min(4096, limits[1])), limits[1]))
    source, sink = os.pipe()
    try:
        high = fcntl.fcntl(source, fcntl.F_DUPFD, 1500)
        os.write(sink, b"a")
        assert await_readable([high], None).readable == {high}
        check_open(high)
        os.close(high)
        with pytest.raises(OSError, match="closed"):
            check_open(high)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
        os.close(source)
        os.close(sink)
