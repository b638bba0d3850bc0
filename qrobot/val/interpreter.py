"""The interpreter: one program that moves the arm, process control programs beside it, and reactions to signals.

Time is the robot's. In each sample every program does steps until it has to wait for something, or has done its share;
then the sample passes. A mistake while it runs stops the arm on its path, and leaves the program where it can go on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from enum import Enum
from typing import Final

from qrobot.errors import LinkError, MotionError, ProgramError, QRobotError, ServoFault
from qrobot.rci.interruption import WholeSamples
from qrobot.val import tree
from qrobot.val.arm import ValArm
from qrobot.val.evaluate import signal_holds
from qrobot.val.machine import Machine
from qrobot.val.parser import parse_line
from qrobot.val.printer import print_line
from qrobot.val.rest_on_path import RestOnPath
from qrobot.val.steps import do_step, is_motion
from qrobot.val.task import ValTask, Waits, Watch

STEPS_PER_SAMPLE: Final = 50  # of each program [A]; VAL II's own rate is not published
MOST_BESIDE: Final = 6  # process control programs at a time [A]
OF_PROGRAMS: Final = ("LOCK", "IGNORE", "RUNSIG")  # what these change lasts as long as the program they stand in
TYPED: Final = "DO"  # name of a program of the one step that is typed at the monitor


class RunState(Enum):
    """States of the program that moves the arm."""

    IDLE = "no program has been executed"
    RUNNING = "running"
    PAUSED = "paused"
    FAILED = "stopped by an error"
    COMPLETED = "completed"
    ABORTED = "aborted"


class Interpreter:
    """Runs programs on an arm.

    Args:
        arm: under control, at rest.
        say: is given each line that programs type.
        ask: gives the answer to a question of PROMPT.

    Attributes:
        machine: what the programs share.
        state: how far the program that moves the arm is.
        message: why it paused, or the error.
        error: what stopped it; None for nothing.
        task: the program that moves the arm; None for none.
        beside: process control programs under way.
        rest: how the arm comes to rest on its path, and what is left to do then.
    """

    def __init__(
        self,
        arm: ValArm,
        say: Callable[[str], None] = print,
        ask: Callable[[str], str] = input,
    ) -> None:
        self.machine = Machine(arm, say, ask)
        self.state = RunState.IDLE
        self.message = ""
        self.error: QRobotError | None = None
        self.task: ValTask | None = None
        self.beside: list[ValTask] = []
        self._whole = WholeSamples()
        self.rest = RestOnPath(self.machine, self._whole)
        self._single = self._single_begun = self._halts = False
        self._failed: ValTask | None = None  # whose step it was that failed

    # ------------------------------------------------------------------------------------------------------- commands

    @property
    def unfinished(self) -> str:
        """Program that could be gone on with, and what became of it, as "main, paused"; "" when there is none."""
        if self.task is None or self.state not in (RunState.PAUSED, RunState.FAILED):
            return ""
        return f"{self.task.name}, {self.state.value},"

    def execute(self, program: str, cycles: int = 1, step: int = 1, single: bool = False) -> RunState:
        """Run a program until it ends, pauses or fails; see `state` and `message`. What ran beside another one ends.

        Raises:
            ProgramError: there is no such program or step, or a structure in it does not match.
            LinkError, ServoFault: the arm is lost.
        """
        self.rest.need_path()
        self.task = ValTask(self.machine, program, cycles=cycles, step=step - 1)
        self.rest.unfinished, self.beside, self._failed = [], [], None
        self.machine.reset_manner()
        return self._run(single)

    def proceed(self, single: bool = False) -> RunState:
        """Go on: first with the motions that were interrupted, then with the step behind. Raises as `execute`.

        An arm that the servo has stopped goes back to its path before. A process control program goes on, too.
        """
        self._need_task()
        self.rest.go_back()
        if stopped := self.machine.arm.kept:
            self.pause(stopped)
            return self.state
        return self._run(single, self._take_up)

    def _take_up(self) -> None:
        """Begin again with the motions that were interrupted, and what the program had asked of its next one."""
        try:
            self.rest.take_up()
        except MotionError as error:
            self._fail(error)
        else:
            self._failed = None
            self.machine.take_up()

    def lead_back(self) -> bool:
        """Lead an arm back to its path that was stopped while no program was under way.

        False when there is nothing of the kind: the arm is on its path, or `proceed` goes on. Raises ProgramError: it
        was stopped again; LinkError, ServoFault: it is lost.
        """
        if self.unfinished or not self.machine.arm.off_path:
            return False
        self.rest.go_back()
        self.rest.need_path()
        return True

    def retry(self) -> RunState:
        """Go on: with the interrupted motions, and with the step that failed once more. Raises as `execute`."""
        self._need_task()
        if self._failed is not None and self._failed.last is not None:
            frame, pc = self._failed.last
            if frame in self._failed.frames:
                frame.pc = pc
        return self.proceed()

    def abort(self) -> None:
        """Give the program up; the arm comes to rest on its path."""
        self.rest.come_to_rest()
        self.machine.arm.unfinished()
        self.machine.forget_next_motion()
        self.task, self.rest.unfinished, self.beside, self._failed = None, [], [], None
        self.state, self.message = RunState.ABORTED, ""

    def do(self, text: str) -> RunState:
        """One step typed at the monitor; a program that is paused stays where it is. Raises as `execute`.

        Without such a program, a step that is stopped or interrupted goes on with `proceed`, as a program would.
        """
        self.rest.need_path()
        line = parse_line(text)
        if isinstance(line.action, tree.Block | tree.ForLoop | tree.CaseValues | tree.Goto):
            raise ProgramError("DO takes a step that stands by itself, no part of a structure", column=1)
        if isinstance(line.action, tree.Reaction) or getattr(line.action, "word", "") in OF_PROGRAMS:
            raise ProgramError(
                "DO takes a step, and this one counts for the rest of a program: put it into one", column=1
            )
        rest = self.rest
        before, motions = self.unfinished, (rest.unfinished, rest.given_up)
        kept, self.error = (self.task, self.state, self.message, self._failed), None
        self.machine.programs[TYPED] = tree.ValProgram(TYPED, (), (line,))
        try:
            self.task, rest.unfinished = ValTask(self.machine, TYPED), []
            if before:
                self.machine.set_aside()
            self._run(single=False)
            rest.need_path()
            if self.error is not None:
                raise self.error
            return self.state
        except KeyboardInterrupt:
            if self.error is not None:  # in the same turn: it is over, and why is worth more
                raise self.error from None
            raise
        finally:
            del self.machine.programs[TYPED]
            if before or self.state is not RunState.PAUSED:
                self.task, self.state, self.message, self._failed = kept
                rest.unfinished, rest.given_up = motions
            self.error = None

    def start_beside(self, program: str, cycles: int) -> None:
        """Begin a process control program, unless it runs already. Raises ProgramError: too many run."""
        if any(task.name == program for task in self.beside):
            return
        if len(self.beside) >= MOST_BESIDE:
            raise ProgramError(f"{MOST_BESIDE} process control programs run already")
        self.beside.append(ValTask(self.machine, program, moves=False, cycles=cycles))

    # ------------------------------------------------------------------------------------------- what steps may ask for

    @contextmanager
    def may_wait(self, task: ValTask) -> Iterator[None]:
        """Block of a step that may wait, for somebody or for the servo: Ctrl-C comes into force in it at once.

        PROCEED then begins the step again.
        """
        try:
            with self._whole.opened():
                yield
        except KeyboardInterrupt:
            task.frame_now.pc -= 1
            raise

    def pause(self, why: str, halt: bool = False) -> None:
        """Stop between steps, and with `halt` the arm on its path; `proceed` goes on, with its motions too."""
        self.state, self.message, self._halts = RunState.PAUSED, why, halt

    def end_of_program(self, task: ValTask) -> Waits | None:
        """RETURN, or the last line: back to the caller, or the end of a cycle."""
        if len(task.frames) == 1:
            return self.end_of_cycle(task)
        task.return_()
        return None

    def end_of_cycle(self, task: ValTask) -> Waits:
        """STOP: leave all calls. The last cycle ends when the arm stands: until then its reactions count."""
        if task.moves and task.cycles == 1:
            yield lambda: self.machine.arm.idle
        while task.frames:
            task.return_()
        if task.cycles != 1:
            task.cycles -= task.cycles > 0
            task.call(task.name, ())

    # -------------------------------------------------------------------------------------------------------- running

    def _need_task(self) -> ValTask:
        if self.task is None or self.state not in (RunState.PAUSED, RunState.FAILED):
            raise ProgramError(f"there is nothing to go on with: {self.state.value}")
        return self.task

    def _run(self, single: bool, first: Callable[[], None] = lambda: None) -> RunState:
        """Do something `first`, and then what the programs say. Raises as `execute`."""
        with self._whole.waiting():
            try:
                with self._whole.one():
                    self.state, self.message, self.error, self._halts = RunState.RUNNING, "", None, False
                    self._single, self._single_begun = single, False
                    first()
                    self._show_running(self.state is RunState.RUNNING)
                self._take_turns()
            except (KeyboardInterrupt, LinkError, ServoFault):
                with self._whole.one():
                    self._interrupted()
                raise
            finally:
                with suppress(QRobotError), self._whole.one():  # a lost arm is told already, or by the next command
                    self._show_running(False)
        return self.state

    def _take_turns(self) -> None:
        """Sample after sample, until the program has ended, paused or failed, and the arm stands."""
        while self.state is RunState.RUNNING:
            with self._whole.one():
                self._turn()
            if self.state is RunState.RUNNING:
                self.machine.arm.sample()
        if self.state is RunState.PAUSED:
            (self.rest.halt if self._halts and not self.machine.arm.off_path else self.rest.settle)()

    def _show_running(self, on: bool) -> None:
        """Switch the signals that RUNSIG has named."""
        for task in filter(None, (self.task, *self.beside)):
            task.show_running(on)

    def _interrupted(self) -> None:
        """Ctrl-C is the panic button: the arm comes to rest, and PROCEED takes up the motion."""
        if self.state in (RunState.FAILED, RunState.COMPLETED):  # in the same turn: the arm stands, and why is told
            return
        self.pause("interrupted")
        try:
            if self.machine.arm.off_path:
                self.rest.pause_on_way_back()  # the path keeps its motions
                return
            self.rest.halt()
        except QRobotError:
            self.task = None  # the arm is lost

    def _turn(self) -> None:
        """Let all programs do their part of one sample; none while the arm is off its path."""
        if stopped := self.machine.arm.kept:
            self.pause(stopped)
            self.machine.arm.pause()  # what was typed alone leads it on, for the program has to go on with it
        if self.machine.arm.off_path:
            return
        if failure := self.machine.arm.failure():
            self._fail(MotionError(failure))
            return
        for task in [task for task in self.beside if task is not self._failed]:
            self._attempt(task)
            if task.over:
                self.beside.remove(task)
                task.show_running(False)
        if self.task is not None and self.state is RunState.RUNNING:
            self._attempt(self.task)
            if self.task.over and self.machine.arm.idle and self.state is RunState.RUNNING:
                self.state = RunState.COMPLETED

    def _attempt(self, task: ValTask) -> None:
        try:
            self._go_on(task)
        except (LinkError, ServoFault):
            raise
        except QRobotError as error:
            self._blame(task, error)

    def _go_on(self, task: ValTask) -> None:
        for _ in range(STEPS_PER_SAMPLE):
            self._react(task)
            waited = task.doing is not None
            if self.state is not RunState.RUNNING or not self._ready(task):
                return
            if waited:  # REACT comes between steps
                continue
            if not task.frames:
                return
            if task is self.task and self._single_is_done(task):
                return
            self._step(task)

    def _ready(self, task: ValTask) -> bool:
        """True when a new step can begin; goes on with what the present one waits for."""
        while task.doing is not None:
            if task.until is not None and not task.until():
                return False
            task.until = next(task.doing, None)
            if task.until is None:
                task.doing = None
            if self.state is not RunState.RUNNING:
                return False
        return True

    def _step(self, task: ValTask) -> None:
        frame = task.frame_now
        if frame.pc >= len(frame.program.lines):
            task.doing = self.end_of_program(task) or task.doing  # that of a step which has been interrupted
            return
        line = frame.program.lines[frame.pc]
        task.at, task.last = (frame.program.name, line.line, line.column), (frame, frame.pc)
        if self.machine.switches["TRACE"]:
            with self._whole.opened():
                self.machine.say(f"{frame.program.name} {frame.pc + 1}: {print_line(line)}")
        frame.pc += 1
        if line.action is not None:
            task.doing = do_step(self, task, line.action) or task.doing
            if self._single and task is self.task:
                self._single_begun = True

    def _single_is_done(self, task: ValTask) -> bool:
        """Pause when NEXT has done its one step, and the arm stands; lines that do nothing are none."""
        if not (self._single and self._single_begun):
            return False
        if not self.machine.arm.idle:  # reactions count until its motion has ended
            task.doing = iter((lambda: self.machine.arm.idle,))
            return True
        self._single_begun = False
        self.pause(f"at step {task.frame_now.pc + 1} of program {task.frame_now.program.name}")
        return True

    # ---------------------------------------------------------------------------------------------- reactions, errors

    def _react(self, task: ValTask) -> None:
        """Call the program of the most urgent signal that has come, now or while it was held back."""
        for number in task.watches:
            on = signal_holds(number, task)
            if on and not task.seen[number]:
                task.pending.add(number)
            task.seen[number] = on
        for number in sorted(task.pending, key=lambda each: -task.watches[each].priority):
            watch = task.watches[number]
            if task.frames and watch.priority > task.priority and (watch.at_once or task.doing is None):
                task.pending.remove(number)
                self._call_reaction(task, watch)
                return

    def _call_reaction(self, task: ValTask, watch: Watch) -> None:
        task.interrupt(watch.program, watch.priority)
        if watch.at_once and task.moves:
            self.rest.give_up_motions()
            task.doing = iter((lambda: self.machine.arm.idle,))
        if task.moves:
            task.keep_next_motion()

    def _blame(self, task: ValTask, error: QRobotError) -> None:
        """An error of a step: with its place; REACTE's program is called, or everything stops."""
        program, line, begun = task.at
        column = max(begun, error.column) if isinstance(error, ProgramError) else begun
        what = error.what if isinstance(error, ProgramError) else str(error)
        told = ProgramError(f"program {program}, {ProgramError(what, line, column)}" if line else what)
        told.line, told.column = line, column
        task.doing = task.until = None
        told = told if task is self.task else ProgramError(f"beside: {told}")
        if task.on_error and task is self.task:
            asked = self.machine.asked_of_next
            if task.last is not None and is_motion(task.last[0].program.lines[task.last[1]].action):
                self.machine.ask_nothing_of_next()  # it was asked of the motion that failed
            try:
                self._call_reaction(task, Watch(task.on_error, task.priority, True))
                task.on_error, self.message = "", str(told)
                return
            except ProgramError as refusal:
                self.machine.behind_reaction(asked)  # RETRY does the motion again
                told = ProgramError(f"{told}; and REACTE: {refusal}")
        self._fail(told)
        self._failed = task

    def _fail(self, error: QRobotError) -> None:
        self.rest.halt()
        self.state, self.message, self.error = RunState.FAILED, str(error), error
