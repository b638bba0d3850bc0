/* event.c - events, which the engine counts and a program waits for. */
#include "channel.h"

int shim_take(volatile int *event, int stays)
{
    int count = __atomic_load_n(event, __ATOMIC_ACQUIRE);
    while (count > 0)
        if (stays || __atomic_compare_exchange_n(event, &count, count - 1, 0, __ATOMIC_ACQ_REL, __ATOMIC_ACQUIRE))
            return 1;
    return 0;
}
