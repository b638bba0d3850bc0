"""Multi-RCCL for programs in C: manipulators as the first argument of every call.

| here | does |
|---|---|
| `include/` | the `rccl.h` of this release |
| `shim/` | its part of the library that programs are linked with |
| `shared_manip` | a manipulator as the program sees it |
| `dispatcher` | what each call does: the table from message to `qrobot.multi_rccl` |
| `__main__` | answers a program that was started by itself |

Transforms and positions are those of `qrobot.rccl.c`, and `qrobot.c_transport` carries the calls.
"""
