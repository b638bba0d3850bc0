/* Four functions of the program at every sample: two of transforms, one of a motion, one given to control. */
#include <stdlib.h>
#include "rccl.h"

int calls;

count()
{
    calls++;
}

main(argc, argv)
int argc;
char **argv;
{
    TRSF_PTR e = gentr_rot("E", 500., 0., -300., yunit, 180.), f = newtrans("F", count), g = newtrans("G", count);

    control(count);
    setmode('c');
    setime(100., atof(argv[1]));
    evalfn(count);
    move(makeposition("P", t6, EQ, e, f, g, TL, e));
    waitfor(completed)
    return calls == 0;
}
