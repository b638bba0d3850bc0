"""Two tasks of RCI take turns on one clock (Lloyd, Parker and McClain 1987, section 4.3.4).

    if ((clock_ticks - offset) % interval == 0) wakeup the task

Both have an interval of 4 ticks; the second one has an offset of 2. No robot is needed. On virtual time the table is
the same in every run.

    qrobot run --offline examples/15_rci_tasks.py
"""

from qrobot.rci import rci_clock, rci_close, rci_control, rci_create, rci_onclock, rci_start, rci_ticks, rci_wait

RUNS = 4  # of the second task


def note(td):
    """The control function of both: a line of the table."""
    print(f"{rci_ticks():>5}  {td.name:<7} {td.run_count:>9}")


rci_clock(100)
first, second = rci_create("first"), rci_create("second")
for task, offset in ((first, 0), (second, 2)):
    rci_control(task, note)
    rci_onclock(task, 4, offset)

print(f"{'tick':>5}  {'task':<7} {'run count':>9}")
rci_start(first.bit | second.bit)
rci_wait(lambda: second.runs >= RUNS)
for task in (first, second):
    print(f"{task.name}: {task.runs} runs, {task.missed} missed")
rci_close()
