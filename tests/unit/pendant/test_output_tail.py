"""What is kept of the output of a process."""

from __future__ import annotations

from qrobot.pendant.output_tail import BYTES_PER_S, MOST_LETTERS, MOST_LINES, OutputTail


def test_lines_come_as_they_were_written_and_steer_no_terminal() -> None:
    tail = OutputTail()
    for data in (b"one\ntw", b"o\r\n\tthree \x1b[31m\xff\nlast"):
        tail.take(data, 0.0)
    assert tail.since(0).lines[:2] == ["one", "two"]
    assert tail.since(2).first == 2
    assert tail.since(2).lines[0].startswith("    three ")
    assert "\x1b" not in tail.since(2).lines[0]
    tail.end()
    assert tail.since(3).lines == ["last"]
    assert tail.since(99) == (4, [])


def test_only_the_newest_lines_are_kept_and_who_asks_for_older_ones_is_told_from_where() -> None:
    tail = OutputTail()
    for number in range(MOST_LINES + 10):
        tail.take(f"{number}\n".encode(), float(number))
    assert tail.since(0) == (10, [str(number) for number in range(10, MOST_LINES + 10)])


def test_a_flood_costs_no_more_than_so_much_a_second_and_what_is_left_out_is_counted() -> None:
    tail, line = OutputTail(), b"x" * 99 + b"\n"
    for _ in range(10):
        tail.take(line * 1000, 5.0)
    tail.take(b"after\n", 6.0)
    lines = tail.since(0).lines
    assert lines[-1] == "after"
    assert sum(len(line) + 1 for line in lines if set(line) == {"x"}) == BYTES_PER_S
    assert f"… {1_000_000 - BYTES_PER_S} bytes of output are left out here" in lines


def test_a_line_without_an_end_is_cut() -> None:
    tail = OutputTail()
    tail.take(b"y" * (3 * MOST_LETTERS + 5), 0.0)
    tail.end()
    assert [len(line) for line in tail.since(0).lines] == [MOST_LETTERS] * 3 + [5]
