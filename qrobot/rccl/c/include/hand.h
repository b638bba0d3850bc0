/* hand.h - OPEN, CLOSE: all in rccl.h; legacy programs include this file too. */
#include "rccl.h"
