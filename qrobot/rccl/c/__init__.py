"""RCCL for programs in C: the calls of the papers as a C library before the engine of this package.

| here | does |
|---|---|
| `include/` | what C programs include |
| `shim/` | the library they are linked with: it turns calls into messages |
| `message` | what program and engine say to each other |
| `shared` | transforms, positions and global variables, in memory that both see |
| `dispatcher` | what each call does: the table from message to `qrobot.rccl` |
| `world` | its transforms and positions |
| `engine` | answers a program until it ends; `__main__` does so for one that was started by itself |
| `program` | starts a program with its engine in this process, for `qrobot run` |

`qrobot.cli.toolchain` compiles both, as `qrobot cc`: it stands apart so that a compiler need not wait for the engine.

The program keeps its own process: debuggers, sanitizers, its signals and its crashes are those of any C program.
"""
