/* rtc.h - control, release, how, chg: all in rccl.h; legacy programs include this file too. */
#include "rccl.h"
