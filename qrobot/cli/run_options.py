"""Options of `qrobot run`, each with its help; some are those of `qrobot val` as well."""

from __future__ import annotations

from typing import Annotated, Literal

from cyclopts import Parameter

from qrobot.cli.arms import LAW_NAMES
from qrobot.cli.option_types import OutputFilm, OutputFolder, OutputLog, RateHz, StartPlace
from qrobot.config.scene import SceneKind

StartOption = Annotated[
    StartPlace | None,
    Parameter(
        help="With --lockstep or --offline: where the arm stands at first, a pose of its robot file (ready, park) or "
        "all joints in degrees and mm, as 0,-90,90,0,0,0; default the `start_pose` of the deployment file."
    ),
]
LockstepOption = Annotated[bool, Parameter(help="On virtual time, without processes.")]
OfflineOption = Annotated[bool, Parameter(help="On virtual time, without a servo.")]
ArmOption = Annotated[
    str | None,
    Parameter(
        help="Which arm of the file; may be left out when there is only one, and for a program of several arms, which "
        "takes them by their names or the addresses of their bridges."
    ),
]
OutputOption = Annotated[
    OutputFolder | None,
    Parameter(
        help="Folder for what is written down; default with --offline out/offline/ and the program's name, else "
        "nothing is."
    ),
]
PlantOption = Annotated[
    Literal["nominal", "mismatched"] | None, Parameter(help="With --lockstep: overrides the deployment file.")
]
SceneOption = Annotated[
    SceneKind | None,
    Parameter(
        help="With --lockstep: what stands around the arm. It overrides what the program says of itself "
        '(`scene = "crank"` below [tool.qrobot] in its head, see the page on touching things), and that overrides the '
        "deployment file."
    ),
]
LawOption = Annotated[
    str | None,
    Parameter(help=f"With --lockstep: control law of the servo, overriding the file's: {LAW_NAMES}."),
]
ModelOption = Annotated[
    str | None,
    Parameter(help="With --lockstep: identified model of the arm (`qrobot identify fit`), overriding the file."),
]
RateOption = Annotated[
    RateHz | None,
    Parameter(help="With --lockstep: cycles per second of the servo, overriding the file: 1000, 2000, 4000, ..."),
]
LogOption = Annotated[
    OutputLog | None,
    Parameter(
        help="With --lockstep: log of every cycle to write, a file (.mcap) or a folder for one; a running arm has its "
        "own, over which nothing is written."
    ),
]
RecordOption = Annotated[
    OutputFilm | None,
    Parameter(
        help="Film of the run to make when it has ended, `.gif`, or `.mp4` where ffmpeg is installed; no screen is "
        "needed. In lock-step that of its log, as `qrobot log animate` makes it; else the arm as the program heard of "
        "it. Of one arm: choose it with --arm. More than four minutes are shown faster."
    ),
]
TracebackOption = Annotated[
    bool, Parameter(help="Show all frames of an exception of the program's, not those in files of yours alone.")
]
