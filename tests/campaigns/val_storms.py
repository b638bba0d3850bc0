"""Storms at the monitor of VAL II: any command in any order, while the arm is disturbed."""

from __future__ import annotations

from tests.support.val_storms import storm

COMMANDS = 12


def campaign(storms: int) -> int:
    """Run so many with each library, and print what went wrong; the number of storms in which something did."""
    wrong = lost = 0
    for library in ("rccl", "arcl"):
        for seed in range(storms):
            found = storm(seed, library, COMMANDS)
            lost += bool(found.lost)
            if found.wrong:
                wrong += 1
                print(f"{library} {seed}:", *found.wrong, *found.told, sep="\n    ", flush=True)
    print(f"{2 * storms} storms, {wrong} wrong, {lost} in which the arm was lost while it came to rest", flush=True)
    return wrong
