"""RCCL for programs in C: the calls of the papers as a C library before the engine of this package.

| here | does |
|---|---|
| `include/` | what C programs include |
| `shim/` | the library they are linked with: it turns calls into messages |
| `shared` | transforms and positions in memory that both see |
| `dispatcher` | what each call does: the table from message to `qrobot.rccl` |
| `object_registry` | its transforms and positions |
| `__main__` | answers a program that was started by itself |
| `program` | starts a program with its engine in this process, for `qrobot run` |

`qrobot.c_transport` carries the calls, for ARCL too. `qrobot.cli.toolchain` compiles both, as `qrobot cc`: it stands
apart so that a compiler need not wait for the engine.

The program keeps its own process: debuggers, sanitizers, its signals and its crashes are those of any C program.
"""
