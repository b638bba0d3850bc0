"""ARCL for programs in C: the calls of `<arcl.h>` before the application interface of this package.

| here | does |
|---|---|
| `include/` | what C programs include |
| `shim/` | the library they are linked with: it turns calls into messages of `qrobot.c_transport` |
| `values` | arguments of a call, out of a message |
| `objects` | transforms, robots and the other objects of a program, by their places in its memory |
| `cell` | how functions of the program are called, with their arguments and answers |
| `calls` | what each call does: the table from its name to `qrobot.arcl` |
| `dispatcher` | answers a program's calls |
| `__main__` | answers a program that was started by itself |

The checks are those of `qrobot.arcl`: an argument goes along with its type, so that what is wrong is told in its words.
"""
