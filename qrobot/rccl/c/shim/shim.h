/* shim.h - what the sources behind rccl.h share. */
#ifndef SHIM_H
#define SHIM_H

#include "channel.h"
#include "rccl.h"

/* shared.c */
TRSF_PTR shim_new_transform(const char *name); /* All zero but its name. */
POS_PTR shim_new_position(const char *name);

#endif
