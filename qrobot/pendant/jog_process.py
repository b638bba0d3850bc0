"""The process that moves one arm for the pendant, with an interpreter of its own: pages must not make setpoints late.

It reads lines of JSON from its input and writes some to its output; at the end of its input, whatever the reason, it
brings the arm to rest and ends.

    {"do": "on", "guide": false, "back": 20.0}, {"do": "off"}, {"do": "press", ...}, {"do": "beat", "number": 3},
    {"do": "release"}, {"do": "stop", "power_off": false}, {"do": "hand", "opened": true}, {"do": "load", "mass": 1.5,
    "centre": [0.0, 0.0, 50.0]}, {"do": "keep", "folder": "out", "name": "left-led", "smooth": 0.003}, {"do": "forget"}
    {"session": "no" | "opening" | "ready", "text": "for people", "guide": false, "led": [2.5, 4.0], "writes": false}

A stop, or a power-off, for which others ask the servo, takes back an "on" that is not done yet, and ends a session.
While the process still compiles an "on" waits, and is told as "opening"; one that has waited for long is not obeyed.
An arm that is jogged goes "back" so many mm from what it met, 0 for not at all. With "guide" it is led by hand; "led"
are the lengths of what was recorded, in s. While it "writes" a recording, which loads this interpreter, the arm is not
taken.
"""

from __future__ import annotations

import json
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, Final, TextIO

from qrobot.config import load_robot
from qrobot.config.deployment import DeployedArm
from qrobot.errors import QRobotError
from qrobot.fences.fence_set import FenceSet, fences_of
from qrobot.fences.in_force import use_fences
from qrobot.pendant.guide_session import GuideSession
from qrobot.pendant.held_press import Press
from qrobot.pendant.jog_session import JogSession
from qrobot.pendant.recording_writer import RecordingWriter
from qrobot.rccl.connect import compile_motion
from qrobot.rccl.setpoints import Setpoints
from qrobot.rci import LinkFactory, TcpLink

PRESSED: Final = "{} was pressed: the pendant does not command the arm; take it to go on"
LATE_S: Final = 3.0  # [A] from "on" until the arm is taken: who has waited for longer does something else
LATE: Final = "the arm is not taken: what moves it was not ready for {:.0f} s; take it now"
WRITES: Final = "the arm is not taken: a recording of it is being written; take it when that is done"


class JogProcess:
    """Sessions of one arm, one after the other.

    Args:
        robot: name or file of the robot.
        link: way to its bridge.
        taught: file of places by name.
        answers: where lines go.
        clock: seconds; that of the presses.
    """

    def __init__(
        self,
        robot: str,
        link: LinkFactory,
        taught: Path,
        answers: TextIO,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._clock = clock
        self._robot, self._link, self._taught, self._answers = robot, link, taught, answers
        self._session: JogSession | GuideSession | None = None
        self._guide, self._back_mm, self._asked_s = False, 0.0, 0.0
        self._led: list[Setpoints] = []
        self._writer = RecordingWriter(robot, partial(self._say, "no"))
        self._wanted = threading.Event()
        self._lock = threading.Lock()  # of the session, and whether one is wanted
        self._why = ""  # somebody has ended the session
        self._over = False

    def read(self, lines: Iterable[str]) -> None:
        """Obey lines until there are no more; for a thread of its own."""
        try:
            for line in lines:
                self._obey(json.loads(line))
        finally:  # a line that nobody can obey is the end of the input as well
            with self._lock:
                self._over = True
                self._leave()
                self._wanted.set()

    def run(self) -> None:
        """Serve until the end of the input."""
        if not self._wanted.is_set():
            self._say("no")
        while not self._over:
            self._wanted.wait()
            with self._lock:
                session = self._begin()
            if session is not None:
                self._serve(session)
        self._writer.close()

    def _begin(self) -> JogSession | GuideSession | None:
        """The session that is wanted; None when that was taken back."""
        if self._over or not self._wanted.is_set():
            return None
        self._wanted.clear()
        if (waited_s := self._clock() - self._asked_s) > LATE_S:
            self._say("no", LATE.format(waited_s))
            return None
        self._why = ""
        self._session = self._new_session()
        return self._session

    def _serve(self, session: JogSession | GuideSession) -> None:
        self._say("opening")
        why = ""
        try:
            session.run()
        except QRobotError as error:
            why = f"the pendant no longer commands the arm: {error}. Take it again to go on"
        with self._lock:
            if why:
                self._wanted.clear()  # a second "on" of the session that has ended does not take the arm again
            self._led, self._session = self._recorded(), None
            why = self._why or why
        self._say("no", why)

    def _new_session(self) -> JogSession | GuideSession:
        tell = lambda text: self._say("ready", text)  # noqa: E731
        if self._guide:
            return GuideSession(self._robot, self._link, self._follows, tell, self._clock)
        return JogSession(self._robot, self._link, self._taught, self._follows, tell, self._clock, self._back_mm)

    def _recorded(self) -> list[Setpoints]:
        """Everything that the arm was led through since the last `forget`."""
        session = self._session
        return [*self._led, *(session.recordings if isinstance(session, GuideSession) else [])]

    def _keep(self, folder: str, name: str, smooth: float) -> None:
        """Write what was led, joined, and smoothed within so many m; 0 for as it was."""
        if self._session is not None or self._wanted.is_set():
            self._say("ready" if self._session else "no", "the recording is not written: let go of the arm first")
            return
        self._writer.write(self._led, Path(folder), name, smooth)
        self._say("no")

    def _follows(self) -> None:
        self._say("ready")

    def _obey(self, message: dict[str, Any]) -> None:
        with self._lock:
            self._do(message)

    def _do(self, message: dict[str, Any]) -> None:
        session, now_s = self._session, self._clock()
        match message.pop("do"):
            case "on":
                self._want(message.get("guide", False), message.get("back", 0.0))
            case "off":
                self._leave()
            case "press" if session is not None:
                session.press.begin(Press(**message), now_s)
            case "beat" if session is not None:
                session.press.beat(message["number"], now_s)
            case "stop":
                self._stop(PRESSED.format("Power off" if message.get("power_off") else "STOP"))
            case "release" if session is not None:
                session.press.end()
            case "hand" if session is not None:
                session.hand(message["opened"])
            case "load" if session is not None:
                session.load(message["mass"], message["centre"])
            case "load":
                self._say("no", "the load is as it was: the arm has just been let go of; set it once more")
            case "keep":
                self._keep(message["folder"], message["name"], message["smooth"])
            case "forget" if session is None:
                self._led = []
                self._say("no")

    def _want(self, guide: bool, back_mm: float) -> None:
        if self._writer.writes:
            self._say("no", WRITES)
            return
        self._asked_s = self._clock()
        if self._session is None:
            self._guide, self._back_mm = guide, back_mm
            self._say("opening")
        self._wanted.set()

    def _stop(self, why: str) -> None:
        self._why = why
        self._leave(why)

    def _leave(self, why: str = "") -> None:
        waits = self._session is None and self._wanted.is_set()
        self._wanted.clear()
        if waits:
            self._say("no", why)
        elif self._session is not None:
            self._session.leave()

    def _say(self, session: str, text: str = "") -> None:
        led = [round(float(motion.t[-1]), 3) for motion in self._recorded()]
        told = {"session": session, "text": text, "guide": self._guide, "led": led, "writes": self._writer.writes}
        try:
            self._answers.write(f"{json.dumps(told)}\n")  # whole, whichever threads tell something
            self._answers.flush()
        except OSError:  # the pendant is gone: the end of the input is near
            self._over = True


def fences_of_told(arm: DeployedArm) -> FenceSet | None:
    """Fences of the arm, with what they need compiled; None for none."""
    robot = load_robot(arm.robot)
    fences = fences_of(arm, robot)
    if fences is not None:
        fences.distances(robot.poses["park"])
    return fences


def main(told: str, taught: str) -> None:
    """Serve the pendant that has started this process for an arm, `told` as JSON."""
    sys.argv[0] = "qrobot pendant"  # how it greets the bridge
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the pendant, whose end ends this
    arm = DeployedArm.model_validate_json(told)
    link: LinkFactory = partial(TcpLink, address=(arm.bridge.host, arm.bridge.port), arm=arm.name)
    process = JogProcess(arm.robot, link, Path(taught), sys.stdout)
    threading.Thread(target=process.read, args=(sys.stdin,), name="messages", daemon=True).start()
    compile_motion(arm.robot)
    with use_fences(fences_of_told(arm)):
        process.run()


if __name__ == "__main__":
    main(*sys.argv[1:])
