"""One driver to an arm, also where the files of another have been removed from the runtime folder.

Its servo drives an arm, or a walk over its board (`qrobot board check`), which has no files; a card has no owner.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from qrobot.errors import LinkBusy
from qrobot.realtime.claimed_name import claimed
from qrobot.realtime.runtime_folder import runtime_path


@contextmanager
def sole_servo(arm: str) -> Iterator[None]:
    """Be the one that drives an arm inside the block. Raises LinkBusy, with its process, when there is another one."""
    with claimed(f"servo of {arm}") as holder:
        if holder:
            who = f"process {holder}" if holder > 0 else "another process"
            raise LinkBusy(
                f"{who} drives {arm}: a servo whose files have been removed from {runtime_path()}, and `qrobot ctl` "
                "does not find it; or a `qrobot board check`. End it, then start again"
            )
        yield
