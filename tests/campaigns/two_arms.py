"""Deaths of what moves two arms that carry one object, at random instants: see `tests.support.two_arm_deaths`."""

from __future__ import annotations

from math import isfinite

from tests.support.two_arm_deaths import KINDS, Verdict, deaths, judge


def campaign(times: int) -> int:
    """Let each kind happen so often; the number of deaths after which something was wrong."""
    verdicts: dict[str, list[Verdict]] = {kind: [] for kind in KINDS}
    for death in deaths(times):
        verdict = judge(death)
        verdicts[death.kind].append(verdict)
        if verdict.wrong:
            print(f"{death}: {verdict.wrong}", flush=True)
    for kind, told in verdicts.items():
        frames, torn_mm = max(each.frames for each in told), max(each.torn_mm for each in told)
        wrong = sum(bool(each.wrong) for each in told)
        apart = f" and {torn_mm:.1f} mm" if isfinite(torn_mm) else ""
        print(f"{kind}: {len(told)} deaths, {wrong} wrong, {frames} frames{apart} at most", flush=True)
    return sum(bool(each.wrong) for told in verdicts.values() for each in told)
