/* shim_world.h - what the sources behind both releases of rccl.h share. */
#ifndef SHIM_WORLD_H
#define SHIM_WORLD_H

#include "channel.h"
#include "rccl_world.h"

/* shared.c */
TRSF_PTR shim_new_transform(const char *name); /* All zero but its name. */
POS_PTR shim_new_position(const char *name);

/* world.c */
int64_t shim_term(TRSF_PTR t); /* A term of an equation in a message; the words EQ, TL and TRANS go along as they are. */

#endif
