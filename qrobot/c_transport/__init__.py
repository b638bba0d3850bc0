"""Transport between a program in C, which keeps its own process, and the engine that serves it, for RCCL and ARCL.

| here | does |
|---|---|
| `message` | what program and engine say to each other |
| `memory` | the pages that both see, and poses in them |
| `assigned_code` | a code that the program assigns and the engine takes |
| `callback_slot` | calls of the program's functions without a message |
| `program_link` | what a library's dispatcher is given, and gives |
| `engine` | answers a program until it ends |
| `program` | starts a program with its engine in this process, for `qrobot run` |

The other end is `qrobot/rccl/c/shim` (`channel.c`, `start.c`, `shared.c`).
"""
