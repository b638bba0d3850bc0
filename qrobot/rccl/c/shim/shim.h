/* shim.h - what the sources behind the rccl.h of one arm share. */
#ifndef SHIM_H
#define SHIM_H

#include "shim_world.h"
#include "rccl.h"

#endif
