/* S-07: two blocks are stacked: six position equations, and no frame computed by hand.
 *
 * Hayward & Paul 1986, section 2.2.2, whose MOVE and OPEN are macros here. The same as examples/11_stack_blocks.py.
 */
#include <stdio.h>
#include "rccl.h"

#define MOVE(p) { distance("dz", -60.); move(p); move(p); waitfor(completed) } /* from above */
#define LEAVE(p) { distance("dz", -60.); move(p); }

main()
{
    TRSF_PTR e, table, block1, block2, final_place, top1, grasp;
    POS_PTR get_block1, place_block1, get_block2, stack_block2;

    e = gentr_trsl("E", 0., 0., 100.);
    table = gentr_rot("TABLE", 500., 50., -300., yunit, 180.);
    block1 = gentr_trsl("BLOCK1", 0., 0., -20.);
    block2 = gentr_trsl("BLOCK2", 0., 100., -20.);
    final_place = gentr_trsl("FINAL_PLACE", -80., 60., -20.);
    top1 = gentr_trsl("TOP1", 0., 0., -40.);
    grasp = gentr_trsl("GRASP", 0., 0., 0.);

    get_block1 = makeposition("get_block1", t6, e, EQ, table, block1, grasp, TL, e);
    place_block1 = makeposition("place_block1", t6, e, EQ, table, final_place, grasp, TL, e);
    get_block2 = makeposition("get_block2", t6, e, EQ, table, block2, grasp, TL, e);
    stack_block2 = makeposition("stack_block2", t6, e, EQ, table, final_place, top1, grasp, TL, e);

    setmode('c');
    setvel(300., 90.);

    MOVE(get_block1)
    CLOSE
    LEAVE(get_block1)
    MOVE(place_block1)
    OPEN
    LEAVE(place_block1)
    MOVE(get_block2)
    CLOSE
    LEAVE(get_block2)
    MOVE(stack_block2)
    OPEN
    LEAVE(stack_block2)
    move(park);
    waitfor(completed)
    printf("two blocks stacked\n");
    return 0;
}
