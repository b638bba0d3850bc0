"""RCI for programs in C: `rci.h`, whose tasks are threads of the program that uses it.

| here | does |
|---|---|
| `include/rci.h` | what C programs include |
| `src/` | the library: C from the program's functions to the bridge, over `qrobot_wire.h` |
| `robot_table` | the data base of robots, as C |
| `relay` | the way from such a program to an arm on virtual time, for `qrobot run --offline` and `--lockstep` |

`qrobot.cli.toolchain` compiles it into the library of `qrobot cc`.
"""
