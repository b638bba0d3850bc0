"""Questions of pages about every cycle of the servos. They are answered in threads; see `scope_process`."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any, Final

from qrobot.errors import QRobotError
from qrobot.pendant.answering_process import AnsweringProcess
from qrobot.pendant.arm_station import ArmStation
from qrobot.pendant.floor import DriveFloor

if TYPE_CHECKING:
    from fastapi import FastAPI

MOST_POINTS: Final = 4000
HEAD: Final = struct.Struct("<I")  # bytes of the JSON object that comes first; curves follow, see `curve_bytes`


def add_scope_queries(app: FastAPI, floor: DriveFloor, scope: AnsweringProcess) -> None:
    """Answer pages with an application of FastAPI."""
    from fastapi import HTTPException, Response

    def of(arm: int) -> ArmStation:
        if not 0 <= arm < len(floor.arms):
            raise HTTPException(404, "there is no such arm")
        return floor.arms[arm]

    def ask(**request: Any) -> tuple[dict[str, Any], bytes]:
        try:
            return scope.ask(**request)
        except QRobotError as error:
            raise HTTPException(404, str(error)) from None

    def picture(**request: Any) -> Response:
        request["points"] = max(2, min(request["points"], MOST_POINTS))
        told, curves = ask(**request)
        head = json.dumps(told).encode()
        return Response(HEAD.pack(len(head)) + head + curves, media_type="application/octet-stream")

    def look(
        arm: int, seconds: float, points: int, trigger: str = "", joint: int = 0, rising: bool = True,
        level: float = 0.0, after: int = 0, before: float = 0.2,
    ) -> Response:  # fmt: skip
        wanted = {"quantity": trigger, "joint": joint, "rising": rising, "level": level} if trigger else None
        name = of(arm).arm.name
        return picture(do="look", arm=name, seconds=seconds, points=points, trigger=wanted, after=after, before=before)

    def keep(arm: int, begin: float, end: float) -> dict[str, Any]:
        return ask(do="keep", arm=of(arm).arm.name, begin=begin, end=end)[0]

    def kept(number: int, begin: float, end: float, points: int) -> Response:
        return picture(do="kept", number=number, begin=begin, end=end, points=points)

    def csv(arm: int, number: int, begin: float, end: float) -> Response:
        joints = list(of(arm).robot.joint_names)
        data = ask(do="csv", number=number, begin=begin, end=end, joints=joints)[1]
        return Response(data, media_type="text/csv")

    for answer in (look, keep, kept, csv):
        app.add_api_route(f"/ask/scope/{answer.__name__}", answer, methods=["GET"], response_model=None)
