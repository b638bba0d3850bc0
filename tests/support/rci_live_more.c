/* The other file of rci_live.c, in the C of 1978. */
#include "rci.h"

double cos();
double swing_angle(run)
long run;
{
    return 0.2 * (1. - cos(run * 0.1));
}
