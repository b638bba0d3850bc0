/* shim.h - what the sources behind the rccl.h of one arm share. */
#ifndef SHIM_H
#define SHIM_H

#include "shim_world.h"
#include "rccl.h"

/* motion.c. The functions of rccl.h are weak: one of such a name may be the program's own, so that we call none of them. */
int shim_control(void); /* Take the arm, unless the program has it. */

#endif
