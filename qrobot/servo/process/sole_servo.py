"""A servo of an arm is the only one, also when the files of another have been removed from the runtime folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from qrobot.errors import LinkBusy
from qrobot.realtime.claimed_name import claimed
from qrobot.realtime.runtime_folder import runtime_path


@contextmanager
def sole_servo(arm: str) -> Iterator[None]:
    """Be the servo of an arm inside the block. Raises LinkBusy, with its process, when there is another one."""
    with claimed(f"servo of {arm}") as holder:
        if holder:
            raise LinkBusy(
                f"a servo of {arm} runs, process {holder}, whose files have been removed from {runtime_path()}: "
                "`qrobot ctl` does not find it. End it, then start again"
            )
        yield
