"""Questions of pages beside the live connection: they read, and change nothing. Behind the gate as everything is."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from qrobot.errors import QRobotError
from qrobot.pendant.arm_station import ArmStation
from qrobot.pendant.floor import DriveFloor
from qrobot.servo.operator.client import ServoClient

if TYPE_CHECKING:
    from fastapi import FastAPI

T = TypeVar("T")
SETPOINT_HEAD: Final = struct.Struct("<IId")  # samples, joints, period in s; then 32-bit floats, sample by sample
LOOK_S: Final = 1.5  # [A] patience with the servo's answer, in a thread for which nobody waits
MOST_SETPOINTS: Final = 200_000  # an hour and a half at 28 ms
MOST_BYTES: Final = 64 << 20  # of a setpoint file


def add_queries(app: FastAPI, floor: DriveFloor) -> None:
    """Answer pages with an application of FastAPI."""
    from fastapi import HTTPException, Response
    from fastapi.responses import PlainTextResponse

    def of(arm: int) -> ArmStation:
        if not 0 <= arm < len(floor.arms):
            raise HTTPException(404, "there is no such arm")
        return floor.arms[arm]

    def told(ask: Callable[[], T]) -> T:
        try:
            return ask()
        except QRobotError as error:
            raise HTTPException(404, str(error)) from None

    def binary(content: bytes) -> Response:
        return Response(content, media_type="application/octet-stream")

    def programs(arm: int) -> dict[str, Any]:
        folder = of(arm).programs.folder
        return {"where": folder.where, "programs": folder.listing()}

    def source(arm: int, name: str) -> PlainTextResponse:
        return PlainTextResponse(told(lambda: of(arm).programs.folder.source(name)))

    def output(arm: int, after: int) -> dict[str, Any]:
        return of(arm).programs.output(after)

    def requests(arm: int) -> PlainTextResponse:
        path = of(arm).programs.result("requests")
        if path is None:
            raise HTTPException(404, "there is no trace of that run")
        return PlainTextResponse(path.read_text(errors="replace"))

    def setpoints(arm: int) -> Response:
        station = of(arm)
        return binary(told(lambda: _setpoints(station.programs.result("setpoints"), station.robot.n)))

    def path(arm: int) -> Response:
        station = of(arm)
        return binary(told(lambda: _setpoints(station.programs.path_ahead, station.robot.n)))

    def board(arm: int, kinds: bool = False) -> dict[str, Any]:
        return of(arm).board.look(kinds)

    def load(arm: int) -> dict[str, Any]:
        return told(lambda: load_of(of(arm).arm.name))

    def procedure(arm: int, after: int) -> dict[str, Any]:
        return of(arm).procedures.output(after)

    for answer in (source, output, requests, setpoints, path):
        app.add_api_route(f"/ask/programs/{answer.__name__}", answer, methods=["GET"], response_model=None)
    app.add_api_route("/ask/programs", programs, methods=["GET"], response_model=None)
    app.add_api_route("/ask/procedure", procedure, methods=["GET"], response_model=None)
    app.add_api_route("/ask/load", load, methods=["GET"], response_model=None)
    app.add_api_route("/ask/board", board, methods=["GET"], response_model=None)


def load_of(arm: str) -> dict[str, Any]:
    """Load that a servo reckons with, and what it takes for a collision. Raises QRobotError: it does not answer."""
    with ServoClient(arm, LOOK_S) as servo:
        status = servo.status()
    return {
        "mass": status.payload_mass,
        "thresholds": [round(each, 1) for each in status.collision_thresholds],
        "reaction": status.collision_reaction,
    }


def _setpoints(path: Path | None, n: int) -> bytes:
    """Setpoints of a file for `n` joints, empty without one."""
    from qrobot.rccl.setpoints import read_setpoints

    if path is None or path.stat().st_size > MOST_BYTES:
        return SETPOINT_HEAD.pack(0, n, 0.0)
    found = read_setpoints(path)
    q = found.q[:MOST_SETPOINTS]
    return SETPOINT_HEAD.pack(*q.shape, found.period_us * 1e-6) + q.astype("<f4").tobytes()
