"""Questions of pages about logs. They are answered in threads, from a process of low priority; see `log_process`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from qrobot.errors import QRobotError
from qrobot.pendant.answering_process import AnsweringProcess
from qrobot.pendant.log_shelf import LogShelf

if TYPE_CHECKING:
    from fastapi import FastAPI

MOST_POINTS: Final = 4000


def add_log_queries(app: FastAPI, shelf: LogShelf, reader: AnsweringProcess) -> None:
    """Answer pages with an application of FastAPI."""
    from fastapi import HTTPException, Response

    def told(ask: Callable[[], Any]) -> Any:
        try:
            return ask()
        except QRobotError as error:
            raise HTTPException(404, str(error)) from None

    def ask(do: str, name: str, **more: Any) -> Any:
        return told(lambda: reader.ask(do=do, path=str(shelf.path_of(name)), **more))

    def logs() -> dict[str, Any]:
        listing = shelf.listing()
        seconds = told(lambda: reader.ask(do="glance", paths=[log["name"] for log in listing]))[0]["seconds"]
        whole = [facts | {"seconds": length} for facts, length in zip(listing, seconds, strict=True)]
        return {"where": shelf.where, "asked": shelf.asked, "logs": whole}

    def begin(name: str) -> Any:
        return ask("open", name)[0]

    def facts(name: str) -> Any:
        return ask("facts", name)[0]

    def curves(name: str, begin: float, end: float, points: int) -> Response:
        points = max(2, min(points, MOST_POINTS))
        data = ask("curves", name, begin=begin, end=end, points=points)[1]
        return Response(data, media_type="application/octet-stream")

    def csv(name: str, begin: float, end: float) -> Response:
        return Response(ask("csv", name, begin=begin, end=end)[1], media_type="text/csv")

    for answer in (begin, facts, curves, csv):
        app.add_api_route(f"/ask/logs/{answer.__name__}", answer, methods=["GET"], response_model=None)
    app.add_api_route("/ask/logs", logs, methods=["GET"], response_model=None)
