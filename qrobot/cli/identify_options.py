"""Options that several commands of `qrobot identify` have."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from qrobot.cli.option_types import LoadKg, PosesOption, Seed

FrictionTermName = Literal["position", "speed", "load"]  # as `qrobot.ident.terms` has it, which is slow to import
RobotFile = Annotated[str | None, Parameter(help="Robot file; default the packaged one that the logs name.")]
KnownTorque = Annotated[bool, Parameter(help="The robot file's torques were measured: no torque scales are sought.")]


@Parameter(name="*")
@dataclass(frozen=True)
class PlanOptions:
    """Options of a plan of swings."""

    poses: Annotated[
        PosesOption, Parameter(help="Poses to swing through, besides the sweeps. More take longer and tell more.")
    ] = 24
    seed: Annotated[Seed, Parameter(help="Of the random poses to choose from; the same seed gives the same plan.")] = 0
    slow: Annotated[bool, Parameter(help="Sweep slowly too, at 1, 2 and 4 %: for friction that falls with speed.")] = (
        False
    )
    dynamic: Annotated[
        bool, Parameter(help="Fast runs for inertia instead of swings and sweeps; --poses and --slow do not count.")
    ] = False


@Parameter(name="*")
@dataclass(frozen=True)
class FitOptions:
    """Options of a fit, beside its logs."""

    robot: RobotFile = None
    loaded: Annotated[
        tuple[Path, ...],
        Parameter(help="Logs of the arm with a load in its hand besides: its mass and centre are found too."),
    ] = ()
    load_kg: Annotated[
        LoadKg | None, Parameter(help="Mass of that load where it was weighed: torque scales are then of true torque.")
    ] = None
    known_torque: KnownTorque = False
    dynamic: Annotated[
        tuple[Path, ...], Parameter(help="Logs of `record --dynamic` of the same arm: its inertia is found too.")
    ] = ()
    friction: Annotated[
        tuple[FrictionTermName | Literal["none"], ...],
        Parameter(help="Seek friction that varies so on every motor; default where residuals show it."),
    ] = ()
    date: Annotated[str | None, Parameter(help="Of the measurement, YYYY-MM-DD; default today.")] = None
