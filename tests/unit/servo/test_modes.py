"""The state machine of the servo, read from its table."""

from __future__ import annotations

from itertools import product

from qrobot.modecodes import mode_name
from qrobot.servo.modes import (
    POWER_ON,
    TORQUE_ON,
    TRANSITIONS,
    Mode,
    gives_torque,
    may_follow,
    mermaid,
    wants_power,
)


def test_every_mode_has_a_row_and_a_way_to_fault_and_back_to_off() -> None:
    assert set(TRANSITIONS) == set(Mode)
    for mode in Mode:
        reachable, frontier = set(), {mode}
        while frontier:
            frontier = {target for origin in frontier for target in TRANSITIONS[origin]} - reachable
            reachable |= frontier
        assert Mode.OFF in reachable
        assert Mode.FAULT in reachable or mode is Mode.FAULT


def test_fault_is_left_for_off_alone() -> None:
    assert set(TRANSITIONS[Mode.FAULT]) == {Mode.OFF}


def test_power_comes_only_from_off_through_powering() -> None:
    into_power = {(o, t) for o, targets in TRANSITIONS.items() for t in targets if o not in POWER_ON and t in POWER_ON}
    assert into_power == {(Mode.OFF, Mode.POWERING)}


def test_tracking_is_entered_only_from_holding_and_left_only_through_a_stop_or_a_fault() -> None:
    assert [o for o, targets in TRANSITIONS.items() if Mode.TRACKING in targets] == [Mode.HOLDING]
    assert set(TRANSITIONS[Mode.TRACKING]) == {Mode.STOPPING, Mode.FAULT}


def test_torque_is_given_only_with_power() -> None:
    assert TORQUE_ON < POWER_ON
    assert {Mode.OFF, Mode.FAULT}.isdisjoint(POWER_ON)


def test_the_compiled_view_is_the_table() -> None:
    for origin, target in product(Mode, Mode):
        assert may_follow(origin, target) == (target in TRANSITIONS[origin])
    for mode in Mode:
        assert wants_power(mode) == (mode in POWER_ON)
        assert gives_torque(mode) == (mode in TORQUE_ON)


def test_the_diagram_shows_every_transition_with_its_reason() -> None:
    diagram = mermaid()
    for origin, targets in TRANSITIONS.items():
        for target, why in targets.items():
            assert f"{origin.name} --> {target.name}: {why}" in diagram


def test_an_unknown_mode_number_still_has_a_name() -> None:
    assert mode_name(4) == "HOLDING"
    assert mode_name(77) == "MODE_77"
