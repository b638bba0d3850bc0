/* task.c - the main of programs that have none, but a pumatask: taken from the library only by them. */
#include "shim.h"

int pumatask();

/* The motions that it leaves are done at exit, as those of any program. */
int main(void)
{
    shim_control();
    pumatask();
    return 0;
}
