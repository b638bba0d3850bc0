/* two_hands.c - two arms grasp an object that a camera tracks, and carry it together (Multi-RCCL; Lloyd, Parker & McClain
 * 1987, section 3.4). The twin of examples/22_two_hands.py.
 *
 *   qrobot cc examples/c/two_hands.c -o two_hands
 *   qrobot run --offline ./two_hands                            two ideal arms
 *   qrobot run --lockstep --deployment two_arms ./two_hands     two emulated ones, on virtual time
 *   qrobot up two_arms & ./two_hands                            the same in real time
 */
#include <math.h>
#include <rccl.h>

int seen = 0; /* samples of the camera */

/* The object as the camera sees it: it drifts along, ever more slowly. */
track(t) TRSF *t;
{
    seen++;
    Trsl(t, 500 - 60 * exp(-0.01 * seen), 0., 20.);
}

main()
{
    MANIP *obj, *robot1, *robot2;
    POS *obj_pos, *p1, *p2;
    TRSF *loc, *cam, *upright, *tool1, *tool2, *coord1, *coord2, *disp1, *disp2, *lifted;

    loc = newtrans("LOC", track);
    cam = gentr_trsl("CAM", 0., 0., 0.);
    upright = gentr_rpy("UPRIGHT", 0., 0., 0., 0., 180., 0.); /* its z axis points down, as a tool's */
    tool1 = gentr_trsl("TOOL1", 0., 0., 150.);
    tool2 = gentr_trsl("TOOL2", 0., 0., 150.);
    coord1 = gentr_trsl("COORD1", 0., 0., 0.); /* the world in the base of either arm: face to face, a metre apart */
    coord2 = gentr_rpy("COORD2", 1000., 0., 0., 180., 0., 0.);
    disp1 = gentr_trsl("DISP1", 0., 100., 0.);
    disp2 = gentr_trsl("DISP2", 0., -100., 0.);

    obj = rccl_open("OBJECT_FRAME");
    rccl_control(obj);
    obj_pos = makePosition(cam, TRANS, EQ, loc, upright, TL, TRANS);
    maintain(obj, obj_pos);

    robot1 = rccl_open("left", "puma560", "127.0.0.1:5600");
    rccl_control(robot1);
    robot2 = rccl_open("right", "puma560", "127.0.0.1:5601");
    rccl_control(robot2);
    p1 = makePosition(TRANS, tool1, EQ, coord1, &obj->trans, disp1, TL, tool1);
    p2 = makePosition(TRANS, tool2, EQ, coord2, &obj->trans, disp2, TL, tool2);

    trackingMode(robot1);
    move(robot1, p1);
    trackingMode(robot2);
    move(robot2, p2);
    wait_for(robot1->completed); /* each goes on tracking while the other is under way */
    wait_for(robot2->completed);
    GRASP(robot1);
    GRASP(robot2);
    printf("both hands hold the object at x = %.1f mm\n", obj->trans.p.x);

    lifted = gentr_rpy("LIFTED", 480., 60., 150., 20., 170., 0.);
    setvel(obj, 100., 30.);
    move(obj, makePosition(TRANS, EQ, lifted, TL, TRANS));
    stop(obj, makePosition(TRANS, EQ, cam, lifted, disp1, TL, TRANS), 500.);
    wait_for(obj->completed);
    printf("carried along one path to x = %.1f mm\n", obj->trans.p.x);
    OPEN(robot1);
    OPEN(robot2);
}
