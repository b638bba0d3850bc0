/* So many short moves: for each a transform and a position are made, moved to and freed, with a function of the program
 * called at every sample and another at every second move. */
#include <stdlib.h>
#include "rccl.h"

int calls;

follow(t)
TRSF_PTR t;
{
    t->p.z = ++calls % 2;
}

watch()
{
    calls++;
}

main(argc, argv)
int argc;
char **argv;
{
    int i, n = atoi(argv[1]);
    TRSF_PTR e = gentr_rot("E", 500., 0., -300., yunit, 180.), f = newtrans("F", follow), a;
    POS_PTR p;

    setmode('c');
    for (i = 0; i < n; i++) {
        a = gentr_trsl("A", 0., i % 2 ? .1 : -.1, 0.);
        p = makeposition("P", t6, EQ, e, a, f, TL, e);
        if (i % 2)
            evalfn(watch);
        setime(28., 28.);
        move(p);
        waitfor(p->end)
        freepos(p);
        freetrans(a);
    }
    return calls == 0;
}
