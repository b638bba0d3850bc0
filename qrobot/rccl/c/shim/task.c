/* task.c - the main of programs that have none, but a pumatask: taken from the library only by them. */
#include "shim.h"

int pumatask();

int main(void)
{
    control();
    pumatask();
    release();
    return 0;
}
