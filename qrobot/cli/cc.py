"""`qrobot cc`: compile a C program for RCCL, Multi-RCCL, RCI or ARCL."""

from __future__ import annotations

import shlex
import subprocess
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from qrobot.cli.console import out
from qrobot.errors import ConfigError


def cc(
    *arguments: Annotated[str, Parameter(allow_leading_hyphen=True)],
    show: bool = False,
    cflags: bool = False,
    libs: bool = False,
    pkg_config: bool = False,
    robot: tuple[Path, ...] = (),
    release: Literal["auto", "1.0", "multi"] = "auto",
) -> int:
    """Compile a program in C that moves an arm through RCCL, Multi-RCCL, RCI or ARCL, legacy programs of the eighties
    included.

    It is the C compiler (that of CC, else cc) with what such programs need: the headers rccl.h, rci.h and arcl.h, C as
    it was then without complaints about it, and the library, of which the linker takes what a program calls. A program
    finds its arm by itself, as one in Python does; `qrobot run` takes it as well.

      qrobot cc prog.c -o prog
      ./prog                         moves the arm of `qrobot up`
      qrobot run --offline ./prog    moves none, and writes down what is asked for
      cc $(qrobot cc --cflags) prog.c -o prog $(qrobot cc --libs)

    Parameters
    ----------
    arguments
        Of the compiler. What begins with -W brings the warnings back; -fsanitize=address is passed on to the library.
    show
        Only print the command.
    cflags
        Only print the options for compiling.
    libs
        Only print the options for linking.
    pkg_config
        Only print a file for pkg-config, to be put into a folder of PKG_CONFIG_PATH as qrobot-rccl.pc.
    robot
        Robot file that tasks of RCI are to know besides the packaged ones; may be given several times.
    release
        Of RCCL: 1.0 for one arm, multi for several manipulators (Multi-RCCL), whose rccl.h is another one. When left
        out the sources tell: those that have a MANIP, or call rccl_open or makePosition, are of Multi-RCCL.
    """
    from qrobot.cli import toolchain

    if pkg_config:
        return _print(toolchain.package_file().rstrip())
    if cflags or libs:
        wanted = [
            *(toolchain.compile_flags(release=release) if cflags else []),
            *(toolchain.link_flags(robots=robot) if libs else []),
        ]
        return _print(shlex.join(wanted))
    if not arguments:
        raise ConfigError("nothing to compile: qrobot cc prog.c -o prog")
    command = toolchain.command_line(arguments, robot, release)
    if show:
        return _print(shlex.join(command))
    return subprocess.run(command, check=False).returncode


def _print(text: str) -> int:
    out.print(text, soft_wrap=True, markup=False)
    return 0
