/* The shortest program. */
#include "rccl.h"

main()
{
    move(park);
    return 0;
}
